"""DICOM series folders through SimpleITK. Slices are put in order by their positions, never by their names.

The place in space is made from the slices' own tags, so that a tilted gantry stays a shear, and a missing or
misplaced slice is told instead of drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.simple_itk import (
    checked_geometry,
    extracted,
    header_of,
    one_line_errors,
    refuse_vectors,
    scalar_type_of,
    simple_itk,
)
from volsplat.mapshade_server.readers.volume_reader import Voxels
from volsplat.protocol import matrices
from volsplat.protocol.errors import BadInput
from volsplat.protocol.matrices import Matrix, Vector
from volsplat.protocol.volume import Box, Geometry, VolumeDescription

IMAGE_IO = "GDCMImageIO"
POSITION, ORIENTATION, PIXEL_SPACING = "0020|0032", "0020|0037", "0028|0030"

GAP_TOLERANCE = 0.02  # of the usual distance of slices; scanners round positions to a few decimals
ORIENTATION_TOLERANCE = 1e-3  # of a direction cosine


def recognises(head: bytes) -> bool:
    return head[128:132] == b"DICM"


@dataclass(frozen=True)
class _Slice:
    path: Path
    columns: int
    rows: int
    scalar_type: str
    position: Vector
    row_direction: Vector  # along which the column index grows
    column_direction: Vector
    spacing: tuple[float, float]  # between rows, between columns, as the tag has it

    @property
    def height(self) -> float:
        """The position along the slices' normal, in mm."""
        return matrices.dot(self.position, matrices.cross(self.row_direction, self.column_direction))


class DicomSeriesReader:
    """One series; only the slices that a box needs are read."""

    def __init__(self, description: VolumeDescription, slices: Sequence[_Slice]) -> None:
        self._description = description
        self._slices = slices

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        ni, nj, nk = box.size
        voxels = np.empty((nk, nj, ni), self._description.scalar_type)
        in_slice = Box((*box.low[:2], 0), (*box.high[:2], 1))
        for n, one in enumerate(self._slices[box.low[2] : box.high[2]]):
            voxels[n] = extracted(one.path, header_of(one.path, IMAGE_IO), in_slice)[0]
        return voxels


def open_slice(path: Path) -> DicomSeriesReader:
    """Refuses a single DICOM file with the cure that fits it."""
    reader = header_of(path, IMAGE_IO)
    size = tuple(reader.GetSize())
    if len(size) > 2 and size[2] > 1:
        raise BadInput(
            f"{path}: a DICOM file of {size[2]} frames, whose spacing volsplat cannot read; convert it to NRRD or NIfTI"
        )
    raise BadInput(f"{path}: one DICOM slice, a 2-D image, volsplat needs a volume: give the folder of its series")


def open_folder(folder: Path) -> DicomSeriesReader:
    """The reader for the series in `folder` that has most slices.

    Raises BadInput where there is none, where slices are damaged or do not stack evenly.
    """
    finder = simple_itk().ImageSeriesReader
    with one_line_errors(folder):
        series = [finder.GetGDCMSeriesFileNames(str(folder), uid) for uid in finder.GetGDCMSeriesIDs(str(folder))]
    _refuse_damaged(folder, {Path(name) for names in series for name in names})
    if not series:
        raise BadInput(f"{folder}: a folder without DICOM images; give a volume file or the folder of a DICOM series")
    series.sort(key=len, reverse=True)
    slices = sorted((_slice_of(Path(name)) for name in series[0]), key=lambda one: one.height)
    geometry = _stacked(folder, slices)
    others = ", ".join(str(len(names)) for names in series[1:])
    description = VolumeDescription(
        name=folder.resolve().name,
        format="DICOM series" + (f" (the largest of {len(series)}; the others have {others} slices)" if others else ""),
        geometry=geometry,
        scalar_type=np.result_type(*(one.scalar_type for one in slices)).name,
        unit="mm",
        anatomical=True,
        reads_sub_cubes=False,
        why_whole="DICOM slices are read whole, though only those that a sub-cube needs",
    )
    return DicomSeriesReader(description, slices)


def _refuse_damaged(folder: Path, in_series: set[Path]) -> None:
    """Raises BadInput for files that say they are DICOM but could not be parsed: slices would silently be missing."""
    for path in sorted(folder.iterdir()):
        if path in in_series or not path.is_file() or path.name.upper() == "DICOMDIR":
            continue
        with path.open("rb") as file:
            claims = recognises(file.read(132))
        if claims:
            raise BadInput(f"{path}: a DICOM file that cannot be parsed, likely truncated; fetch it again or remove it")


def _slice_of(path: Path) -> _Slice:
    reader = header_of(path, IMAGE_IO)
    size = tuple(reader.GetSize())
    if len(size) > 2 and size[2] > 1:
        raise BadInput(f"{path}: a DICOM file of {size[2]} frames in a series; convert the series to NRRD or NIfTI")
    if reader.GetNumberOfComponents() != 1:
        refuse_vectors(path, f"{reader.GetNumberOfComponents()} components a voxel")
    position = _numbers(path, reader, POSITION, "ImagePositionPatient", 3)
    orientation = _numbers(path, reader, ORIENTATION, "ImageOrientationPatient", 6)
    spacing = _numbers(path, reader, PIXEL_SPACING, "PixelSpacing", 2)
    return _Slice(
        path=path,
        columns=size[0],
        rows=size[1],
        scalar_type=scalar_type_of(path, reader),
        position=(position[0], position[1], position[2]),
        row_direction=(orientation[0], orientation[1], orientation[2]),
        column_direction=(orientation[3], orientation[4], orientation[5]),
        spacing=(spacing[0], spacing[1]),
    )


def _numbers(path: Path, reader: Any, key: str, name: str, count: int) -> list[float]:
    text = reader.GetMetaData(key) if reader.HasMetaDataKey(key) else ""
    try:
        values = [float(word) for word in text.split("\\")]
    except ValueError:
        values = []
    if len(values) != count:
        raise BadInput(f"{path}: has no usable {name}, so it has no place in a series; export the series again")
    return values


def _stacked(folder: Path, slices: Sequence[_Slice]) -> Geometry:
    """The place of the whole stack. Raises BadInput where slices differ in kind or are not evenly spaced."""
    first, last = slices[0], slices[-1]
    if len(slices) == 1:
        raise BadInput(f"{folder}: a 2-D image, volsplat needs a volume: the series has one slice; give all its slices")
    for one in slices[1:]:
        if (one.columns, one.rows, one.spacing) != (first.columns, first.rows, first.spacing):
            raise BadInput(
                f"{folder}: slices {first.path.name} and {one.path.name} differ in size or pixel spacing; "
                "put one series alone into a folder"
            )
        turned = max(
            abs(a - b)
            for a, b in zip(
                (*first.row_direction, *first.column_direction),
                (*one.row_direction, *one.column_direction),
                strict=True,
            )
        )
        if turned > ORIENTATION_TOLERANCE:
            raise BadInput(
                f"{folder}: slices {first.path.name} and {one.path.name} are oriented differently; "
                "put one orientation alone into a folder"
            )
    _check_even(folder, slices)
    between_rows, between_columns = first.spacing
    step = matrices.scaled(matrices.minus(last.position, first.position), 1 / (len(slices) - 1))
    matrix: Matrix = matrices.transposed(
        (
            matrices.scaled(first.row_direction, between_columns),
            matrices.scaled(first.column_direction, between_rows),
            step,
        )
    )
    return checked_geometry(folder, (first.columns, first.rows, len(slices)), matrix, first.position)


def _check_even(folder: Path, slices: Sequence[_Slice]) -> None:
    gaps = [after.height - before.height for before, after in zip(slices, slices[1:], strict=False)]
    usual = median(gaps)
    for before, after, gap in zip(slices, slices[1:], gaps, strict=False):
        between = f"{before.path.name} and {after.path.name}"
        if gap <= GAP_TOLERANCE * max(usual, max(gaps)):
            raise BadInput(
                f"{folder}: slices {between} lie at one position; put one phase or echo of the series into a folder"
            )
        if abs(gap - usual) > GAP_TOLERANCE * usual:
            raise BadInput(
                f"{folder}: slices are missing or uneven: {between} are {gap:g} mm apart, the others {usual:g} mm; "
                "complete the series or resample it"
            )
