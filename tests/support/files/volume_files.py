"""Volumes in files for the tests of readers: made here, in every format and in ways that SimpleITK does not write."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import SimpleITK as sitk
import torch

from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Matrix

DIMS: Index = (7, 6, 5)
SKEWED: Matrix = ((0.9, 0.2, 0.1), (-0.1, 1.2, -0.4), (0.05, 0.3, -1.8))
TURNED: Matrix = ((0.0, -1.25, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 3.0))  # right-angled, axes exchanged
ALL_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64")


def values_of(scalar_type: str, dims: Index = DIMS) -> Voxels:
    """Every voxel different, up to the type's limits; floats hold NaN and infinities."""
    count = dims[0] * dims[1] * dims[2]
    kind = np.dtype(scalar_type)
    if kind.kind == "f":
        values = np.linspace(-1e3, 1e3, count).astype(kind)
        values[:3] = np.nan, np.inf, -np.inf
    else:
        limits = np.iinfo(kind)
        values = np.arange(count).astype(kind)
        values[:2] = limits.min, limits.max
    return values.reshape(dims[::-1])


def written(path: Path, values: Voxels, matrix: Matrix = TURNED) -> Path:
    geometry = Geometry(dims=tuple(values.shape[::-1]), index_to_physical=matrix, origin=(10.0, -20.5, 30.25))
    write_volume(path, torch.from_numpy(values), geometry)
    return path


def sheared_nifti(path: Path, values: Voxels, matrix: Matrix) -> Path:
    """A NIfTI file whose sform is sheared, which SimpleITK would straighten: its header is written over."""
    written(path, values)
    raw = bytearray(path.read_bytes())
    raw[252:256] = np.array([0, 2], "<i2").tobytes()
    rows = np.zeros((3, 4), "<f4")
    rows[:, :3] = np.array(matrix) * [[-1], [-1], [1]]
    raw[280:328] = rows.tobytes()
    path.write_bytes(raw)
    return path


def dicom_series(
    folder: Path,
    values: Voxels,
    heights: Sequence[float] | None = None,
    tilt: float = 0.0,
    series: str = "1.2.3.4.5",
    prefix: str = "",
) -> Path:
    """int16 slices at `heights` mm, shifted by `tilt` mm backwards for each mm up, named against their order."""
    folder.mkdir(exist_ok=True)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    writer.SetImageIO("GDCMImageIO")
    count = len(values)
    for n, height in enumerate(heights if heights is not None else [3.0 * n for n in range(count)]):
        image = sitk.GetImageFromArray(values[n].astype(np.int16))
        image.SetSpacing((0.5, 0.75))
        tags = {
            "0008|0060": "CT",
            "0020|000e": series,
            "0020|000d": "1.2.3.4",
            "0008|0018": f"{series}.{n + 1}",
            "0020|0032": f"-10\\{20 + tilt * height:g}\\{height:g}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
            "0020|0013": str(n + 1),
        }
        for tag, value in tags.items():
            image.SetMetaData(tag, value)
        target = folder / f"{prefix}{(n * 7) % 11}{n}.dcm"
        writer.SetFileName(str(target))
        writer.Execute(image)
        target.rename(target.with_suffix(""))
    return folder
