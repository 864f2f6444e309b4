"""What is drawn without a word said of it: real volumes, a phantom of each kind, a head in every format and array."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import h5py
import nibabel
import numpy as np
import SimpleITK
import torch
import zarr

from support.checkout import SHARED_DATA
from support.files.samples import FOLDER_SAMPLES, OF_VOXELS, SAMPLES
from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms import PHANTOMS, make_phantom
from volsplat.client.phantoms.volume_writer import COMPRESSED, write_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Geometry

HEAD = (36, 48, 42)  # voxels
PHANTOM_SIDES = 48


@dataclass(frozen=True)
class Subject:
    name: str
    make: Callable[[Path], Any]  # in a folder of its own; what `volsplat.render` takes
    block: bool = False  # see Score.faults
    grain: bool = False


# Real volumes, each format and kind of data: the same voxels in another byte order look the same. Of those that are
# left out, Format8msb.sgy is noise by its own values, and small.sgy a ramp of 5 x 5 traces.
REAL: dict[str, dict[str, bool]] = {
    "ct_head/ct_head_96x128x113.nrrd": {},
    "ct_head/cthead_256x256x113.nrrd": {},
    "dicom_ct_phantom": {"block": True},  # for the board that it lies on
    "dicom_multiframe/emri_small.dcm": {},
    "dicom_multiframe/emri_small_RLE.dcm": {},
    "dicom_multiframe/emri_small_jpeg_2k_lossless.dcm": {},
    "galaxy/l1448_13co.fits": {},
    "galaxy/ngc6946.fits": {},
    "hemoglobin/4HHB.pdb": {"grain": True},
    "maps/3ek3-2fofc.map.gz": {"block": True, "grain": True},
    "maps/3ek3.cif": {"grain": True},
    "maps/EMD-3001.map": {"grain": True},
    "maps/EMD-3197.map": {"grain": True},
    "metaimage/HeadMRVolume.mhd": {},
    "metaimage/frogtissue.mhd": {},
    "nifti/CT_pitch.nii.gz": {},
    "nifti/avg152T1_LR_nifti.nii.gz": {},
    "nifti/big.nii.gz": {},
    "nrrd/pynrrd/BallBinary30x30x30_bz2.nrrd": {},
    "nrrd/template_T2.nrrd": {},
    "odd/neghip_64x64x64_stack.tif": {},
    "odd/slab_compressed_s16.mha": {},
    "odd/slab_multifile.nhdr": {},
    "odd/slab_sform_shear_slope.nii.gz": {},
    "odd/slab_u16_deflate.tif": {},
    "orbital/benzene-homo.cube": {"grain": True},
    "orbital/hydrogen_3d_64x64x64.vti": {},
    "seismic/Format1msb.sgy": {"block": True},
    "seismic/f3.sgy": {"block": True},
    "sod/1JK9_l_u.pdb": {"grain": True},
    "sod/sod_density_97x97x116.nhdr": {"grain": True},
    "structure_factors/5e5z.pdb": {"grain": True},
    "structure_factors/r5wkdsf.ent": {"grain": True},
    "trna/1ehz.pdb": {"grain": True},
    "volvis/nucleon_41x41x41_uint8.raw": {},
    "volvis/tooth_103x94x161_uint8.nhdr": {},
}

# Of these the sheet alone has pictures: they show what another one shows, or take long.
MORE = (
    *("ct_head/cthead_256x256x113.nrrd", "dicom_multiframe/emri_small_RLE.dcm", "hemoglobin/4HHB.pdb", "maps/3ek3.cif"),
    *("dicom_multiframe/emri_small_jpeg_2k_lossless.dcm", "odd/slab_multifile.nhdr", "odd/slab_u16_deflate.tif"),
    *("orbital/hydrogen_3d_64x64x64.vti", "seismic/Format1msb.sgy", "sod/1JK9_l_u.pdb"),
)

BLOCKS = ("marschner-lobb", "seismic")  # phantoms that fill their grid
GRAINS = ("rna", "protein", "structure-factors")
SIGNALS = ("ramp", "slab")  # without a form, made to measure by
OTHERWISE = ("DICOM series", "FITS cube (.fits, .fits.gz)")  # whose samples lie otherwise; real ones are there


def real_volumes() -> list[Subject]:
    """None where the checkout has none beside it."""
    names = REAL if SHARED_DATA.is_dir() else {}
    return [Subject(name, partial(_real, name), **nature) for name, nature in names.items()]


def phantoms() -> list[Subject]:
    names = [name for name in PHANTOMS if name not in SIGNALS]
    return [Subject(f"{name} .nrrd", partial(written_phantom, name), name in BLOCKS, name in GRAINS) for name in names]


def heads() -> list[Subject]:
    """The same head, as every format that is written or read has it, and every kind of array."""
    names = [name for name in OF_VOXELS if name not in OTHERWISE]
    return [
        *(Subject(f"head {ending}", partial(_written, ending)) for ending in COMPRESSED),
        *(Subject(f"head, {name}", partial(_read, name)) for name in names),
        *(Subject(f"head, {name}", partial(_held, name)) for name in ARRAYS),
    ]


def _real(name: str, folder: Path) -> Path:
    return SHARED_DATA / name


def written_phantom(name: str, folder: Path, side: int = PHANTOM_SIDES) -> Path:
    """As `volsplat phantom` writes it, with its kind."""
    from click.testing import CliRunner

    from volsplat.client.command.phantom_command import phantom

    path = folder / f"{name}.nrrd"
    done = CliRunner().invoke(phantom, [name, "-o", str(path), "--size", str(side)])
    assert done.exit_code == 0, done.output
    return path


def _written(ending: str, folder: Path) -> Path:
    path = folder / f"head{ending}"
    write_volume(path, torch.from_numpy(_head()), Geometry(HEAD))
    return path


def _read(name: str, folder: Path) -> Path:
    values = _head() // 16  # which pictures of 8 bits hold, too
    if name.startswith("FreeSurfer"):  # i to the left, j down, k to the front
        values = values[::-1, ::-1].transpose(1, 0, 2)
    return {**SAMPLES, **FOLDER_SAMPLES}[name](folder, values)


def _held(name: str, folder: Path) -> Any:
    array = ARRAYS[name](_head(), folder)
    return Volume(array, spacing=(1, 1, 1)) if name in BARE else array


@cache
def _head() -> Voxels:
    """int16 [z, y, x]; x to the left, y to the back, z up."""
    return make_phantom("head", size=HEAD)[0].numpy().astype(np.int16)


# What takes long to import is imported by whoever runs the test, and not by all who collect it.
def _in_chunks(values: Voxels, folder: Path) -> Any:
    import dask.array

    return dask.array.from_array(values, chunks=(16, 16, 48))


def _labelled(values: Voxels, folder: Path) -> Any:
    import xarray

    coords = {axis: np.arange(count) for axis, count in zip("xyz", values.shape[::-1], strict=True)}
    return xarray.DataArray(values, coords, ("z", "y", "x"))


def _of_vtk(values: Voxels, folder: Path) -> Any:
    import pyvista

    image = pyvista.ImageData(dimensions=values.shape[::-1])
    image.point_data["density"] = values.ravel()
    return image


BARE: dict[str, Callable[[Voxels, Path], Any]] = {
    "numpy": lambda values, folder: values,
    "torch": lambda values, folder: torch.from_numpy(values),
    "dask": _in_chunks,
    "zarr": lambda values, folder: zarr.create_array(store=folder / "v.zarr", data=values, chunks=(16, 16, 48)),
    "h5py": lambda values, folder: h5py.File(folder / "v.h5", "w").create_dataset("v", data=values),
}
ARRAYS = {
    **BARE,
    "xarray": _labelled,
    "SimpleITK": lambda values, folder: SimpleITK.GetImageFromArray(values),
    "nibabel": lambda values, folder: nibabel.Nifti1Image(values.T, np.diag([-1.0, -1.0, 1.0, 1.0])),
    "pyvista": _of_vtk,
}
