"""Dose grids of RT: each frame lies where its offset says, which counts from the first frame or is z itself."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import tolerances
from support.files.dicom_files import AXIAL, head, numbered, saved, with_pixels
from support.files.opened import described, read_whole, refused

RTDOSE = "1.2.840.10008.5.1.4.1.1.481.2"
PRONE, FROM_ABOVE = (-1.0, 0.0, 0.0, 0.0, -1.0, 0.0), (1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
CORONAL = (1.0, 0.0, 0.0, 0.0, 0.0, -1.0)
POSITION = (-10.0, 20.0, -400.0)
VALUES = numbered(4)


def dose(folder: Path, offsets: Sequence[float], orientation: Sequence[float] = AXIAL) -> Path:
    one = head(RTDOSE, Modality="RTDOSE", PixelSpacing=[2.0, 2.0], GridFrameOffsetVector=list(offsets))
    one.ImagePositionPatient, one.ImageOrientationPatient = list(POSITION), list(orientation)
    return saved(folder / "dose.dcm", with_pixels(one, VALUES))


@pytest.mark.parametrize("orientation", [AXIAL, PRONE, FROM_ABOVE])
@pytest.mark.parametrize("step", [3.0, -3.0], ids=["up", "down"])
def test_offsets_that_are_z_put_each_frame_at_that_z(
    step: float, orientation: tuple[float, ...], tmp_path: Path
) -> None:
    heights = [POSITION[2] + step * n for n in range(4)]
    path = dose(tmp_path, heights, orientation)
    geometry, values = described(path).geometry, read_whole(path)
    for plane, height in zip(VALUES, heights, strict=True):
        (k,) = (n for n, sheet in enumerate(values) if np.array_equal(sheet, plane))
        expected = (*POSITION[:2], height)
        assert geometry.physical((0, 0, k)) == pytest.approx(expected, rel=tolerances.GEOMETRY_PRINTED)


@pytest.mark.parametrize("orientation", [AXIAL, CORONAL])
def test_offsets_from_0_begin_at_the_grids_position(orientation: tuple[float, ...], tmp_path: Path) -> None:
    path = dose(tmp_path, [0.0, 3.0, 6.0, 9.0], orientation)
    np.testing.assert_array_equal(read_whole(path), VALUES)
    assert described(path).geometry.origin == POSITION


@pytest.mark.parametrize(
    ("offsets", "orientation"),
    [([5.0, 8.0, 11.0, 14.0], AXIAL), ([-400.0, -397.0, -394.0, -391.0], CORONAL)],
    ids=["from nowhere", "not axial"],
)
def test_offsets_that_begin_elsewhere_are_refused(
    offsets: list[float], orientation: tuple[float, ...], tmp_path: Path
) -> None:
    assert f"its GridFrameOffsetVector begins with {offsets[0]:g}" in refused(dose(tmp_path, offsets, orientation))
