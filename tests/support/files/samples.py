"""One small file or folder of each format that the readers know, by the format's name in their table."""

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gemmi
import h5py
import numpy as np
import segyio
import tifffile
import zarr
from astropy.io import fits
from PIL import Image

from support.files.map_files import map_file, map_values
from support.files.reflection_files import mtz
from support.files.volume_files import dicom_series, values_of, written
from volsplat.protocol.description.shared_array import packed_header
from volsplat.protocol.description.volume import Geometry, VolumeDescription

VALUES = np.random.default_rng(0).integers(0, 30000, (20, 30, 40)).astype(np.int16)  # half of which is not all of it
DIMS = "40 30 20"
GRID = 'WholeExtent="0 39 0 29 0 19" Origin="0 0 0" Spacing="1 1 1"'
PDB = "".join(
    f"ATOM  {n:5d}  CA  ALA A{n:4d}    {n:8.3f}{0:8.3f}{0:8.3f}  1.00 20.00           C  \n" for n in range(99)
)


def image(name: str) -> Callable[[Path], Path]:
    return lambda folder: written(folder / name, VALUES)


def text(name: str, content: str) -> Callable[[Path], Path]:
    return lambda folder: _with(folder / name, content.encode())


def _with(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def analyze(folder: Path) -> Path:
    _with(folder / "v.img", VALUES.tobytes())
    head = struct.pack("<i36x8h", 348, 3, 40, 30, 20, 1, 1, 1, 1).ljust(70, b"\0") + struct.pack(
        "<2h8f", 4, 16, *[1.0] * 8
    )
    return _with(folder / "v.hdr", head.ljust(108, b"\0") + bytes(240))


def mgh(folder: Path) -> Path:
    head = struct.pack(">7ih15f", 1, 40, 30, 20, 1, 4, 0, 1, *[1.0] * 3, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 0)
    return _with(folder / "v.mgh", head.ljust(284, b"\0") + VALUES.astype(">i2").tobytes())


def slices(folder: Path, save: Callable[[Any, Path], object]) -> Path:
    folder = folder / "slices"
    folder.mkdir()
    for n, one in enumerate(VALUES):
        save(one, folder / f"s{n}")
    return folder


def fits_cube(folder: Path) -> Path:
    fits.PrimaryHDU(VALUES).writeto(folder / "v.fits")
    return folder / "v.fits"


def segy(folder: Path) -> Path:
    spec = segyio.spec()
    spec.samples, spec.format, spec.tracecount = np.arange(40) * 4.0, 5, 600
    with segyio.create(folder / "v.sgy", spec) as file:
        for n in range(600):
            file.header[n] = {189: n // 30 + 1, 193: n % 30 + 1, 117: 4000}
            file.trace[n] = np.full(40, n, np.float32)
    return folder / "v.sgy"


def hdf5(folder: Path) -> Path:
    with h5py.File(folder / "v.h5", "w") as file:
        file["v"] = VALUES
    return folder / "v.h5"


def netcdf(folder: Path) -> Path:
    """Version 1: three dimensions, no attributes, one variable."""
    lengths = b"".join(
        struct.pack(">i4si", 1, name, size) for name, size in zip((b"z", b"y", b"x"), VALUES.shape, strict=True)
    )
    variable = struct.pack(">i4si3i2i", 1, b"v", 3, 0, 1, 2, 0, 0)
    head = b"CDF\1" + struct.pack(">3i", 0, 10, 3) + lengths + struct.pack(">4i", 0, 0, 11, 1) + variable
    head += struct.pack(">3i", 3, VALUES.nbytes, len(head) + 12)
    return _with(folder / "v.nc", head + VALUES.astype(">i2").tobytes())


def npz(folder: Path) -> Path:
    np.savez(folder / "v.npz", v=VALUES)
    return folder / "v.npz"


def npy(folder: Path) -> Path:
    np.save(folder / "v.npy", VALUES)
    return folder / "v.npy"


def vti(folder: Path) -> Path:
    head = f'<VTKFile type="ImageData" byte_order="LittleEndian"><ImageData {GRID}><Piece Extent="0 39 0 29 0 19">'
    array = '<PointData Scalars="v"><DataArray type="Int16" Name="v" format="appended" offset="0"/></PointData></Piece>'
    head += f'{array}</ImageData><AppendedData encoding="raw">_'
    return _with(folder / "v.vti", head.encode() + struct.pack("<I", VALUES.nbytes) + VALUES.tobytes())


def zarr_folder(folder: Path) -> Path:
    array = zarr.create_array(folder / "v.zarr", shape=VALUES.shape, chunks=(10, 30, 40), dtype="int16")
    array[...] = VALUES
    return folder / "v.zarr"


LEGACY = "# vtk DataFile Version 3.0\nv\nBINARY\nDATASET STRUCTURED_POINTS\n"
LEGACY += f"DIMENSIONS {DIMS}\nORIGIN 0 0 0\nSPACING 1 1 1\n"
LEGACY += f"POINT_DATA {VALUES.size}\nSCALARS v short 1\nLOOKUP_TABLE default\n"
CUBE = (
    " v\n density\n    0 0.0 0.0 0.0\n    4 1.0 0.0 0.0\n    5 0.0 1.0 0.0\n    6 0.0 0.0 1.0\n" + "1.5 " * 120 + "\n"
)


def shared(folder: Path) -> Path:
    geometry = Geometry((VALUES.shape[2], VALUES.shape[1], VALUES.shape[0]))
    told = VolumeDescription(name="v", format="array in memory", geometry=geometry, scalar_type="int16")
    return _with(folder / "v", packed_header(told) + VALUES.tobytes())


SAMPLES: dict[str, Callable[[Path], Path]] = {
    "NRRD (.nrrd, .nhdr)": image("v.nrrd"),
    "MetaImage (.mha, .mhd)": image("v.mha"),
    "NIfTI (.nii, .nii.gz)": image("v.nii"),
    "Analyze 7.5 (.hdr, .img)": analyze,
    "Analyze or NIfTI voxels (.img)": lambda folder: analyze(folder).with_suffix(".img"),
    "FreeSurfer (.mgh, .mgz)": mgh,
    "DICOM series (a folder)": lambda folder: next(dicom_series(folder / "series", VALUES[:6]).iterdir()),
    "TIFF stack (.tif, .ome.tif)": image("v.tif"),
    "PDB or PQR coordinates (.pdb, .pqr)": text("v.pdb", PDB),
    "mmCIF (.cif)": text("v.cif", gemmi.read_pdb_string(PDB).make_mmcif_document().as_string()),
    "MTZ structure factors (.mtz)": lambda folder: mtz(folder / "v.mtz"),
    "CCP4/MRC map (.map, .mrc)": lambda folder: map_file(folder / "v.map", map_values("float32")),
    "FITS cube (.fits, .fits.gz)": fits_cube,
    "SEG-Y survey (.sgy, .segy)": segy,
    "Gaussian cube (.cube)": text("v.cube", CUBE),
    "HDF5 dataset (.h5, .nxs)": hdf5,
    "NetCDF-3 (.nc)": netcdf,
    "NumPy array (.npy)": npy,
    "NumPy arrays (.npz)": npz,
    "VTK image or grid (.vti, .vtr)": vti,
    "VTK image or grid (.vtk)": lambda folder: _with(
        folder / "v.vtk", LEGACY.encode() + VALUES.astype(">i2").tobytes()
    ),
    "Zarr (.zarr, .zarr.zip)": lambda folder: Path(shutil.make_archive(str(folder / "v"), "zip", zarr_folder(folder))),
    "array in memory": shared,
    "raw voxels (.raw)": lambda folder: _with(folder / "v_40x30x20_int16.raw", VALUES.tobytes()),
}

FOLDER_SAMPLES: dict[str, Callable[[Path], Path]] = {
    "Zarr": zarr_folder,
    "TIFF slices": lambda folder: slices(folder, lambda one, path: tifffile.imwrite(path.with_suffix(".tif"), one)),
    "pictures": lambda folder: slices(
        folder, lambda one, path: Image.fromarray(one.astype(np.uint8)).save(path.with_suffix(".png"))
    ),
    "DICOM series": lambda folder: dicom_series(folder / "series", values_of("int16")),
}
