"""The text of `volsplat info`."""

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from volsplat.client.scene.contour_scenes import Level
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.volume_info import (
    HISTOGRAM_COLUMNS,
    HISTOGRAM_ROWS,
    histogram_text,
    info_text,
    orientation_text,
)
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.rules.index_rules import Survey

SURVEY = Survey(low=-1024.0, high=782.0, max_gradient=310.0, voxels=1000, no_data=0)
COUNTS = [900, 60, 0, 30, 10]


def description(matrix: Matrix = IDENTITY, anatomical: bool = True, **changes: object) -> VolumeDescription:
    return VolumeDescription(
        name="study",
        format="DICOM series",
        geometry=Geometry(dims=(10, 20, 5), index_to_physical=matrix),
        scalar_type="int16",
        unit="mm",
        anatomical=anatomical,
        **changes,  # type: ignore[arg-type]
    )


def printed(
    what: VolumeDescription,
    survey: Survey = SURVEY,
    counts: list[int] | None = None,
    strength_counts: Sequence[int] = (),
    strength_scale: float = 0.0,
    contour: Level | None = None,
) -> str:
    console = Console(width=120, record=True, file=None, quiet=False)
    extremes = BlockExtremes.nothing(what.geometry.dims)
    known = SurveyedVolume(what, survey, counts or COUNTS, list(strength_counts), extremes)
    vars(known).update(automatic_window=(-500.0, 700.0), strength_scale=strength_scale)  # in place of what would follow
    with console.capture() as capture, pytest.MonkeyPatch.context() as patched:
        patched.setattr(SurveyedVolume, "subject", lambda known: None)
        patched.setattr("volsplat.client.volume.volume_info.contour_level", lambda subject: contour)
        console.print(info_text(known))
    return capture.get()


def test_it_tells_all_that_is_known() -> None:
    text = printed(description(((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 5.0))))
    for part in ("study (DICOM series)", "10 x 20 x 5", "0.5 x 0.5 x 5 mm", "LPS", "int16", "-1024 to 782", "none"):
        assert part in text
    assert "value: -500 becomes 0, 700 becomes 255" in text
    assert "gradient strength" in text and "only their sub-cube" in text and "█" in text


def test_it_tells_what_strength_255_stands_for_and_that_stronger_ones_are_the_same() -> None:
    told = " ".join(printed(description(), strength_scale=255 / 200.0, strength_counts=[90, 5, 3, 2]).split())
    assert (
        "gradient strength: 0 becomes 0, 200 per unit of length becomes 255, and so do stronger ones, up to 310" in told
    )
    assert "half of the voxels are below 77.5" in told
    all_told = printed(description(), strength_scale=255 / SURVEY.max_gradient)
    assert "310 per unit of length becomes 255" in all_told and "stronger" not in all_told


def test_it_tells_where_the_first_picture_has_its_contour() -> None:
    assert "0.505, 1.5 sigma above the mean" in printed(description(), contour=Level(0.505, "1.5 sigma above the mean"))
    assert "contour" not in printed(description())


def test_it_tells_the_kind_what_states_it_and_what_the_classes_are() -> None:
    bands = (Band("liver", 1, 1), Band("C", 64, 95))
    told = printed(description(kind=Kind.LABELS, kind_from="the segments in its header", bands=bands))
    assert "labels (the segments in its header)" in told and "liver 1, C 64 to 95" in told


def test_a_kind_that_nothing_states_is_told() -> None:
    assert "not stated by the file; its histogram decides" in printed(description())


def test_it_tells_why_a_file_is_read_whole() -> None:
    text = printed(description(reads_sub_cubes=False, why_whole="the file is compressed by gzip"))
    assert "one of them the whole file" in text and text.count("the file is compressed by gzip") == 1


def test_it_tells_what_else_each_server_reads() -> None:
    text = printed(description(why_whole="the list of atoms is read whole"))
    assert "only their sub-cube and its halo; the list of atoms is read whole" in text


def test_it_names_a_second_scalar() -> None:
    text = printed(description(density_name="amplitude", strength_name="phase", second_scalar=(-180.0, 180.0)))
    assert "amplitude: -500" in text and "phase: -180 becomes 0, 180 becomes 255" in text
    assert "gradient strength" not in text and "per unit of length" not in text


def test_it_counts_what_is_not_a_number() -> None:
    assert "25 of 1000 voxels (2.50%)" in printed(
        description(), Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=1000, no_data=25)
    )


def test_a_volume_without_any_value_is_told() -> None:
    empty = Survey(low=math.inf, high=-math.inf, max_gradient=0.0, voxels=1000, no_data=1000)
    assert "no voxel has a value" in printed(description(), empty, [0] * 8)


def placed(geometry: Geometry, unit: str = "mm", anatomical: bool = False) -> VolumeDescription:
    return VolumeDescription(
        name="head", format="NRRD", geometry=geometry, scalar_type="uint8", unit=unit, anatomical=anatomical
    )


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        (IDENTITY, "LPS"),
        (((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)), "RAS"),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)), "LPI, left-handed"),
        (((0.0, 0.0, 2.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)), "PIL"),
        (((1.0, 0.0, 0.0), (0.0, 0.96, -0.28), (0.0, 0.28, 0.96)), "LPS, oblique by 16.3 degrees"),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 0.5), (0.0, 0.0, 1.0)), "LPS, oblique by 26.6 degrees, skewed by 26.6 degrees"),
    ],
)
def test_orientations_are_told_in_letters(matrix: Matrix, expected: str) -> None:
    text = orientation_text(placed(Geometry(dims=(2, 2, 2), index_to_physical=matrix), anatomical=True))
    handed = expected if "PIL" not in expected else text
    assert text.startswith(expected) and text == handed


def test_without_a_patient_the_plain_axes_are_told() -> None:
    text = orientation_text(placed(Geometry(dims=(2, 2, 2))))
    assert "+x, +y, +z" in text and "LPS" not in text and "the file does not say how a patient lies" in text


def test_nobody_looks_for_a_patient_in_a_galaxy() -> None:
    assert "patient" not in orientation_text(placed(Geometry(dims=(2, 2, 2)), unit="arcmin"))


@given(
    counts=st.lists(st.integers(0, 10**9), min_size=1, max_size=300).filter(any),
    low=st.floats(-1e30, 1e30),
    width=st.floats(0, 1e30),
)
def test_any_histogram_is_drawn_within_its_frame(counts: list[int], low: float, width: float) -> None:
    survey = Survey(low=low, high=low + width, max_gradient=0.0, voxels=sum(counts), no_data=0)
    lines = histogram_text(survey, counts, (low, low + width)).split("\n")
    assert len(lines) == HISTOGRAM_ROWS + 2
    assert "█" in lines[0]
    assert all(len(line) <= HISTOGRAM_COLUMNS + len("  999999999999 voxels") for line in lines)
