"""Where NRRD files say that their voxels lie: every space of the format, and axes by their ends, centres and units."""

from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

import tolerances
from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

VALUES = values_of("uint8", (4, 3, 2))
DIRECTIONS = "space directions: (0,2,0) (1.5,0,0.25) (0,0,-3)\nspace origin: (1,2,3)"
STEPS = np.array([[0, 1.5, 0], [2, 0, 0], [0, 0.25, -3]])


def written(path: Path, fields: str, kind: str = "uint8") -> Path:
    head = f"NRRD0005\ntype: {kind}\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{fields}\n\n"
    path.write_bytes(head.encode() + VALUES.tobytes())
    return path


def described(folder: Path, fields: str) -> VolumeDescription:
    return open_volume(str(written(folder / "volume.nrrd", fields))).description


TO_LPS = {
    "right-anterior-superior": (-1, -1, 1),
    "RAS": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "LAS": (1, -1, 1),
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
}


@pytest.mark.parametrize("space", TO_LPS)
def test_a_patients_space_becomes_lps_also_with_time(space: str, tmp_path: Path) -> None:
    signs = TO_LPS[space]
    with_time = space + ("t" if len(space) == 3 else "-time")
    timed = DIRECTIONS.replace(")", ",0)")
    for fields in (f"space: {space}\n{DIRECTIONS}", f"space: {with_time}\n{timed}"):
        told = described(tmp_path, fields)
        np.testing.assert_array_equal(told.geometry.index_to_physical, np.diag(signs) @ STEPS)
        assert told.geometry.origin == (signs[0] * 1, signs[1] * 2, signs[2] * 3)
        assert told.anatomical and told.unit == "mm" and not told.warnings


@pytest.mark.parametrize("space", ["3D-right-handed", "3D right handed", "scanner-xyz"])
def test_a_right_handed_space_stays_as_it_is(space: str, tmp_path: Path) -> None:
    told = described(tmp_path, f"space: {space}\n{DIRECTIONS}")
    np.testing.assert_array_equal(told.geometry.index_to_physical, STEPS)
    assert not told.anatomical and not told.warnings


def test_a_left_handed_space_is_drawn_without_mirroring(tmp_path: Path) -> None:
    """The same things in space, told in left-handed axes and in right-handed ones, differ by a rotation only."""
    left = described(tmp_path, f"space: 3D-left-handed\n{DIRECTIONS}")
    swapped = "space directions: (2,0,0) (0,1.5,0.25) (0,0,-3)\nspace origin: (2,1,3)"  # x and y exchanged
    right = described(tmp_path, f"space: 3D-right-handed\n{swapped}")
    turn = np.array(right.geometry.index_to_physical) @ np.linalg.inv(left.geometry.index_to_physical)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=tolerances.GEOMETRY_FLOAT64)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ left.geometry.origin, right.geometry.origin)
    (warning,) = left.warnings
    assert "3D-left-handed is drawn with y turned round" in warning


def test_a_space_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r'"space: left-superior-front" is no space of NRRD\'s, so that left and right'):
        described(tmp_path, f"space: left-superior-front\n{DIRECTIONS}")


def test_a_space_without_directions_tells_that_sides_are_unknown(tmp_path: Path) -> None:
    told = described(tmp_path, "space: LAS\nspacings: 2 1 3")
    assert told.geometry.spacing == (2, 1, 3) and not told.anatomical
    assert told.warnings == (
        "the header names the space LAS but gives no directions in it: left and right cannot be told",
    )


@pytest.mark.parametrize(
    ("fields", "steps", "origin"),
    [
        ("axis mins: 0 0 0\naxis maxs: 8 3 6", (2, 1, 3), (1, 0.5, 1.5)),
        ("axismins: 0 0 0\naxismaxs: 9 4 6\ncenterings: node node node", (3, 2, 6), (0, 0, 0)),
        ("axis mins: 0 1 0\naxis maxs: 8 5 6\ncenters: cell node ???", (2, 2, 3), (1, 1, 1.5)),
        ("axis mins: 8 0 0\naxis maxs: 0 3 6", (-2, 1, 3), (7, 0.5, 1.5)),  # counted backwards: kept
        ("axis maxs: 8 3 6\nspacings: 2 1 3", (2, 1, 3), (1, 0.5, 1.5)),
        ("axis mins: 5 0 nan\naxis maxs: nan 3 nan\nspacings: 2 nan 3", (2, 1, 3), (6, 0.5, 0)),
    ],
)
def test_axes_lie_where_their_ends_are(
    fields: str, steps: tuple[float, ...], origin: tuple[float, ...], tmp_path: Path
) -> None:
    told = described(tmp_path, fields)
    np.testing.assert_allclose(told.geometry.index_to_physical, np.diag(steps))
    assert told.geometry.origin == origin and not told.warnings


@pytest.mark.parametrize("centers", ["", "centers: cell cell cell\n", "centers: node node node\n"])
def test_first_voxels_lie_where_simple_itk_has_them(centers: str, tmp_path: Path) -> None:
    path = written(tmp_path / "volume.nrrd", f"{centers}spacings: 2 1 3\naxis mins: 10 20 30", kind="uchar")
    image = sitk.ReadImage(str(path))
    geometry = open_volume(str(path)).description.geometry
    assert geometry.origin == image.GetOrigin() and geometry.spacing == image.GetSpacing()


def test_ends_that_disagree_with_the_spacing_are_told(tmp_path: Path) -> None:
    told = described(tmp_path, "spacings: 2 1 3\naxis mins: 0 0 0\naxis maxs: 8 30 6")
    assert told.geometry.spacing == (2, 1, 3)
    assert told.warnings == ("axis mins and maxs of j are 10 a voxel; its spacing 1 is used",)


def test_an_axis_without_spacing_is_told(tmp_path: Path) -> None:
    assert described(tmp_path, "spacings: 2 nan 3").warnings == ("the header states no spacing of j: taken as 1",)
    assert described(tmp_path, "").warnings == ()


def test_lengths_of_several_units_are_brought_to_the_first(tmp_path: Path) -> None:
    told = described(tmp_path, 'spacings: 2 1 3\nunits: "mm" "um" "cm"')
    assert told.unit == "mm" and told.geometry.spacing == pytest.approx((2, 0.001, 30))
    told = described(tmp_path, f'space: RAS\n{DIRECTIONS}\nspace units: "um" "mm" "mm"')
    assert told.unit == "µm" and told.geometry.origin == pytest.approx((-1, -2000, 3000))
    told = described(tmp_path, 'spacings: 2 1 3\nunits: "mm" "mm" "s"')
    assert told.unit == "" and "several units (mm, mm, s)" in told.warnings[0]


def test_the_unit_of_values_is_kept_and_a_measurement_frame_moves_nothing(tmp_path: Path) -> None:
    frame = "measurement frame: (0,1,0) (-1,0,0) (0,0,1)\nthicknesses: nan nan 9\nsample units: HU"
    told = described(tmp_path, f"space: LPS\n{DIRECTIONS}\n{frame}")
    np.testing.assert_array_equal(told.geometry.index_to_physical, STEPS)
    assert told.value_unit == "HU"
