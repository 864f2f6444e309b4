"""One small file or folder of each format that the readers know, by the format's name in their table.

Those whose format holds any voxels, `OF_VOXELS`, are of the int16 voxels [z, y, x] that are given, or of VALUES.
"""

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

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
from support.files.volume_files import dicom_series, written
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.shared_array import packed_header
from volsplat.protocol.description.volume import Geometry, VolumeDescription

VALUES = np.random.default_rng(0).integers(0, 30000, (20, 30, 40)).astype(np.int16)  # half of which is not all of it


class Sample(Protocol):
    def __call__(self, folder: Path, values: Voxels = ...) -> Path: ...


PDB = "".join(
    f"ATOM  {n:5d}  CA  ALA A{n:4d}    {n:8.3f}{0:8.3f}{0:8.3f}  1.00 20.00           C  \n" for n in range(99)
)


def image(name: str) -> Sample:
    return lambda folder, values=VALUES: written(folder / name, values)


def text(name: str, content: str) -> Sample:
    return lambda folder, values=VALUES: _with(folder / name, content.encode())


def _with(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def analyze(folder: Path, values: Voxels = VALUES) -> Path:
    _with(folder / "v.img", values.tobytes())
    head = struct.pack("<i36x8h", 348, 3, *values.shape[::-1], 1, 1, 1, 1).ljust(70, b"\0") + struct.pack(
        "<2h8f", 4, 16, *[1.0] * 8
    )
    return _with(folder / "v.hdr", head.ljust(108, b"\0") + bytes(240))


def mgh(folder: Path, values: Voxels = VALUES) -> Path:
    head = struct.pack(">7ih15f", 1, *values.shape[::-1], 1, 4, 0, 1, *[1.0] * 3, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 0)
    return _with(folder / "v.mgh", head.ljust(284, b"\0") + values.astype(">i2").tobytes())


def slices(folder: Path, values: Voxels, save: Callable[[Any, Path], object]) -> Path:
    folder = folder / "slices"
    folder.mkdir()
    for n, one in enumerate(values):
        save(one, folder / f"s{n:03d}")
    return folder


def fits_cube(folder: Path, values: Voxels = VALUES) -> Path:
    fits.PrimaryHDU(values).writeto(folder / "v.fits")
    return folder / "v.fits"


def segy(folder: Path, values: Voxels = VALUES) -> Path:
    spec = segyio.spec()
    spec.samples, spec.format, spec.tracecount = np.arange(40) * 4.0, 5, 600
    with segyio.create(folder / "v.sgy", spec) as file:
        for n in range(600):
            file.header[n] = {189: n // 30 + 1, 193: n % 30 + 1, 117: 4000}
            file.trace[n] = np.full(40, n, np.float32)
    return folder / "v.sgy"


def hdf5(folder: Path, values: Voxels = VALUES) -> Path:
    with h5py.File(folder / "v.h5", "w") as file:
        file["v"] = values
    return folder / "v.h5"


def netcdf(folder: Path, values: Voxels = VALUES) -> Path:
    """Version 1: three dimensions, no attributes, one variable."""
    lengths = b"".join(
        struct.pack(">i4si", 1, name, size) for name, size in zip((b"z", b"y", b"x"), values.shape, strict=True)
    )
    variable = struct.pack(">i4si3i2i", 1, b"v", 3, 0, 1, 2, 0, 0)
    head = b"CDF\1" + struct.pack(">3i", 0, 10, 3) + lengths + struct.pack(">4i", 0, 0, 11, 1) + variable
    head += struct.pack(">3i", 3, values.nbytes, len(head) + 12)
    return _with(folder / "v.nc", head + values.astype(">i2").tobytes())


def npz(folder: Path, values: Voxels = VALUES) -> Path:
    np.savez(folder / "v.npz", v=values)
    return folder / "v.npz"


def npy(folder: Path, values: Voxels = VALUES) -> Path:
    np.save(folder / "v.npy", values)
    return folder / "v.npy"


def vti(folder: Path, values: Voxels = VALUES) -> Path:
    extent = " ".join(f"0 {count - 1}" for count in values.shape[::-1])
    grid = f'WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1"'
    head = f'<VTKFile type="ImageData" byte_order="LittleEndian"><ImageData {grid}><Piece Extent="{extent}">'
    array = '<PointData Scalars="v"><DataArray type="Int16" Name="v" format="appended" offset="0"/></PointData></Piece>'
    head += f'{array}</ImageData><AppendedData encoding="raw">_'
    return _with(folder / "v.vti", head.encode() + struct.pack("<I", values.nbytes) + values.tobytes())


def zarr_folder(folder: Path, values: Voxels = VALUES) -> Path:
    array = zarr.create_array(folder / "v.zarr", shape=values.shape, chunks=(10, 30, 40), dtype="int16")
    array[...] = values
    return folder / "v.zarr"


def legacy_vtk(folder: Path, values: Voxels = VALUES) -> Path:
    dims = " ".join(map(str, values.shape[::-1]))
    head = "# vtk DataFile Version 3.0\nv\nBINARY\nDATASET STRUCTURED_POINTS\n"
    head += f"DIMENSIONS {dims}\nORIGIN 0 0 0\nSPACING 1 1 1\n"
    head += f"POINT_DATA {values.size}\nSCALARS v short 1\nLOOKUP_TABLE default\n"
    return _with(folder / "v.vtk", head.encode() + values.astype(">i2").tobytes())


def raw(folder: Path, values: Voxels = VALUES) -> Path:
    dims = "x".join(map(str, values.shape[::-1]))
    return _with(folder / f"v_{dims}_int16.raw", values.tobytes())


CUBE = (
    " v\n density\n    0 0.0 0.0 0.0\n    4 1.0 0.0 0.0\n    5 0.0 1.0 0.0\n    6 0.0 0.0 1.0\n" + "1.5 " * 120 + "\n"
)


def shared(folder: Path, values: Voxels = VALUES) -> Path:
    geometry = Geometry((values.shape[2], values.shape[1], values.shape[0]))
    told = VolumeDescription(name="v", format="array in memory", geometry=geometry, scalar_type="int16")
    return _with(folder / "v", packed_header(told) + values.tobytes())


SAMPLES: dict[str, Sample] = {
    "NRRD (.nrrd, .nhdr)": image("v.nrrd"),
    "MetaImage (.mha, .mhd)": image("v.mha"),
    "NIfTI (.nii, .nii.gz)": image("v.nii"),
    "Analyze 7.5 (.hdr, .img)": analyze,
    "Analyze or NIfTI voxels (.img)": lambda folder, values=VALUES: analyze(folder, values).with_suffix(".img"),
    "FreeSurfer (.mgh, .mgz)": mgh,
    "DICOM series (a folder)": lambda folder, values=VALUES: next(
        dicom_series(folder / "series", values[:6]).iterdir()
    ),
    "TIFF stack (.tif, .ome.tif)": image("v.tif"),
    "PDB or PQR coordinates (.pdb, .pqr)": text("v.pdb", PDB),
    "mmCIF (.cif)": text("v.cif", gemmi.read_pdb_string(PDB).make_mmcif_document().as_string()),
    "MTZ structure factors (.mtz)": lambda folder, values=VALUES: mtz(folder / "v.mtz"),
    "CCP4/MRC map (.map, .mrc)": lambda folder, values=VALUES: map_file(folder / "v.map", map_values("float32")),
    "FITS cube (.fits, .fits.gz)": fits_cube,
    "SEG-Y survey (.sgy, .segy)": segy,
    "Gaussian cube (.cube)": text("v.cube", CUBE),
    "HDF5 dataset (.h5, .nxs)": hdf5,
    "NetCDF-3 (.nc)": netcdf,
    "NumPy array (.npy)": npy,
    "NumPy arrays (.npz)": npz,
    "VTK image or grid (.vti, .vtr)": vti,
    "VTK image or grid (.vtk)": legacy_vtk,
    "Zarr (.zarr, .zarr.zip)": lambda folder, values=VALUES: Path(
        shutil.make_archive(str(folder / "v"), "zip", zarr_folder(folder, values))
    ),
    "array in memory": shared,
    "raw voxels (.raw)": raw,
}

FOLDER_SAMPLES: dict[str, Sample] = {
    "Zarr": zarr_folder,
    "TIFF slices": lambda folder, values=VALUES: slices(
        folder, values, lambda one, path: tifffile.imwrite(path.with_suffix(".tif"), one)
    ),
    "pictures": lambda folder, values=VALUES: slices(
        folder, values, lambda one, path: Image.fromarray(one.astype(np.uint8)).save(path.with_suffix(".png"))
    ),
    "DICOM series": lambda folder, values=VALUES: dicom_series(folder / "series", values),
}

OF_VOXELS = (
    *("Analyze 7.5 (.hdr, .img)", "FreeSurfer (.mgh, .mgz)", "FITS cube (.fits, .fits.gz)", "HDF5 dataset (.h5, .nxs)"),
    *("NetCDF-3 (.nc)", "NumPy array (.npy)", "NumPy arrays (.npz)", "VTK image or grid (.vti, .vtr)"),
    *("VTK image or grid (.vtk)", "Zarr (.zarr, .zarr.zip)", "raw voxels (.raw)", *FOLDER_SAMPLES),
)
