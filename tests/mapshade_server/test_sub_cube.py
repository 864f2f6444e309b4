"""Sub-cubes: values that cannot be surveyed are refused, whatever the partition."""

import pytest
import torch

from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.text.errors import BadInput

GEOMETRY = Geometry(dims=(4, 3, 2))
LEFT = Box((0, 0, 0), (2, 3, 2))


def with_greatest(value: float) -> torch.Tensor:
    values = torch.zeros((2, 3, 4), dtype=torch.float64)
    values[0, 0, 0] = value
    return values


@pytest.mark.parametrize("value", [1.7e308, -1.7e308, 1e200, -1e155])
@pytest.mark.parametrize("box", [None, LEFT])
def test_values_whose_differences_overflow_are_refused_in_one_line(value: float, box: Box | None) -> None:
    sub_cube = SubCube.of_volume(GEOMETRY, with_greatest(value), box)
    with pytest.raises(BadInput, match="too far for gradients; divide them by a constant") as refusal:
        sub_cube.survey()
    assert "\n" not in str(refusal.value)
    assert ("NaN" in str(refusal.value)) == (abs(value) > 1e300)  # a fill value: dividing would not help


@pytest.mark.parametrize("value", [3.4e38, -3.4e38, 1e100, float("inf"), float("nan")])
def test_all_others_are_surveyed_with_their_gradients(value: float) -> None:
    survey = SubCube.of_volume(GEOMETRY, with_greatest(value)).survey()
    if survey.no_data:
        assert survey.max_gradient == 0
    else:
        assert max(abs(survey.low), abs(survey.high)) == abs(with_greatest(value)).max()
        assert survey.max_gradient > 0


def test_a_steep_step_between_near_voxels_is_refused_too() -> None:
    fine = Geometry(dims=(4, 3, 2), index_to_physical=((1e-60, 0.0, 0.0), (0.0, 1e-60, 0.0), (0.0, 0.0, 1e-60)))
    with pytest.raises(BadInput, match="too far for gradients"):
        SubCube.of_volume(fine, with_greatest(1e100)).survey()


def test_a_volume_without_any_value_is_surveyed() -> None:
    survey = SubCube.of_volume(GEOMETRY, torch.full((2, 3, 4), float("nan"))).survey()
    assert survey.no_data == survey.voxels and survey.low > survey.high
