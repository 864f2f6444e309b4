"""What lengths in a picture are told in."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ROUNDING
from volsplat.client.volume.scales import Scale, round_length, scale_text, scales_of
from volsplat.protocol.description.volume import Geometry, GridAxis, VolumeDescription

CUBIC = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
STEEP = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0))


def axis(name: str, unit: str, step: float) -> GridAxis:
    return GridAxis(name=name, unit=unit, first=0.0, step=step)


SKY = (axis("RA", "deg", -0.02), axis("Dec", "deg", 0.02), axis("velocity", "km/s", 4))
SURVEY = (axis("time", "ms", 4), axis("crossline", "", 1), axis("inline", "", 1))
COUNTED = (axis("time", "ms", 4), axis("crossline", "", 1), axis("inline", "", 2))


@pytest.mark.parametrize(
    ("steps", "unit", "axes", "scales"),
    [
        (STEEP, "mm", None, [("", "mm", 1.0)]),
        (CUBIC, "", None, [("", "voxels", 1.0)]),
        (STEEP, "", None, [("i, j", "voxels", 1.0), ("k", "voxels", 2.0, 2)]),
        (STEEP, "arcmin", SKY, [("RA, Dec", "arcmin", 1.0), ("velocity", "km/s", 0.5, 2)]),
        (STEEP, "m", SURVEY, [("crossline, inline", "m", 1.0), ("time", "ms", 0.25, 0)]),
        (STEEP, "", COUNTED, [("time", "ms", 0.25, 0), ("crossline, inline", "", 1.0)]),
    ],
)
def test_each_kind_of_axis_or_of_spacing_has_a_scale(
    steps: tuple[tuple[float, float, float], ...],
    unit: str,
    axes: tuple[GridAxis, GridAxis, GridAxis] | None,
    scales: list[tuple[Any, ...]],
) -> None:
    geometry = Geometry(dims=(4, 5, 6), index_to_physical=steps)  # type: ignore[arg-type]
    described = VolumeDescription(name="v", format="f", geometry=geometry, scalar_type="uint8", unit=unit, axes=axes)
    assert list(scales_of(described)) == [Scale(*scale) for scale in scales]


def test_a_bar_is_told_by_its_axes_its_length_and_its_unit() -> None:
    assert scale_text(Scale("RA, Dec", "arcmin", 1.0), 20.0) == "RA, Dec 20 arcmin"
    assert scale_text(Scale("", "voxels", 1.0), 1.0) == "1 voxel"


@given(st.floats(1e-12, 1e12))
def test_a_round_length_is_1_2_or_5_and_no_other_such_one_is_nearer(most: float) -> None:
    length = round_length(most)
    assert f"{length:e}"[0] in "125" and float(f"{length:.0e}") == length
    assert length <= most < 2.5 * length * (1 + ROUNDING)
