"""Where samples land on the screen: the plan's fixed point against the view's definition in real numbers."""

import math

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import mapping
from support.scenes.arbitrary import plain_scene, quaternions, situations
from tolerances import A_LATTICE_STEP, DDA_DRIFT, HALF_A_LATTICE_STEP, ROUNDING
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.grid_on_screen import grid_on_screen
from volsplat.protocol.rules.packet_layout import SUBPIXEL_BITS
from volsplat.protocol.rules.resolved_view import FIT_FRACTION, bounding_radius, resolved_zoom
from volsplat.protocol.rules.rounding import TO_NEAREST


@given(situations(largest=40), st.sampled_from(Step))
def test_positions_of_the_plan_are_the_exact_ones_on_the_lattice(situation: tuple[Scene, Geometry], step: Step) -> None:
    scene, geometry = situation
    plan = plan_frame(scene, geometry, step)
    samples = mapping.samples_of(scene, geometry, plan)
    off = (samples.lattice.double() / 2**SUBPIXEL_BITS - samples.exact).abs().max()
    rounded = HALF_A_LATTICE_STEP if plan.thresholds == TO_NEAREST else A_LATTICE_STEP
    assert off <= rounded + DDA_DRIFT


def test_i_runs_right_j_up_and_k_to_the_viewer_when_nothing_is_turned() -> None:
    scene = plain_scene(view=View(zoom=3.0), size=(65, 33))
    geometry = Geometry((5, 5, 5))
    points = torch.tensor([[2.0, 2, 2], [3, 2, 2], [2, 3, 2], [2, 2, 3]], dtype=torch.float64)
    screen = mapping.on_screen(points, scene, geometry)
    assert screen.tolist() == [[32, 16], [35, 16], [32, 13], [32, 16]]
    assert grid_on_screen(scene, geometry).pixels_per_index[2][2] > 0


def test_rotation_turns_by_the_right_hand_rule() -> None:
    quarter = math.sqrt(0.5)
    about_z = matrices.rotation_from_quaternion((0.0, 0.0, quarter, quarter))
    assert matrices.applied(about_z, (1.0, 0.0, 0.0)) == pytest.approx((0, 1, 0), abs=ROUNDING)
    about_x = matrices.rotation_from_quaternion((quarter, 0.0, 0.0, quarter))
    assert matrices.applied(about_x, (0.0, 1.0, 0.0)) == pytest.approx((0, 0, 1), abs=ROUNDING)


@given(quaternions)
def test_rotation_matrix_is_the_quaternion_s_and_keeps_handedness(
    quaternion: tuple[float, float, float, float],
) -> None:
    rotation = matrices.rotation_from_quaternion(quaternion)
    expected = mapping.rotated(quaternion, torch.eye(3, dtype=torch.float64)).T
    assert torch.allclose(torch.tensor(rotation, dtype=torch.float64), expected, rtol=0, atol=ROUNDING)
    assert matrices.determinant(rotation) == pytest.approx(1, abs=ROUNDING)


@given(situations())
def test_chosen_grid_point_is_at_the_centre_of_the_image(situation: tuple[Scene, Geometry]) -> None:
    scene, geometry = situation
    center = scene.view.center
    if center == "middle":
        center = tuple((size - 1) / 2 for size in geometry.dims)  # type: ignore[assignment]
    screen = mapping.on_screen(torch.tensor([center], dtype=torch.float64), scene, geometry)
    middle = torch.tensor([(scene.image.width - 1) / 2, (scene.image.height - 1) / 2], dtype=torch.float64)
    assert torch.allclose(screen[0], middle, rtol=0, atol=ROUNDING)


@given(situations())
def test_zoom_is_pixels_per_reference_spacing(situation: tuple[Scene, Geometry]) -> None:
    scene, geometry = situation
    pixels = abs(matrices.determinant(grid_on_screen(scene, geometry).pixels_per_index)) ** (1 / 3)
    assert pixels == pytest.approx(scene.view.zoom, rel=ROUNDING)


@given(situations())
def test_fit_keeps_every_cell_inside_the_image_from_any_side(situation: tuple[Scene, Geometry]) -> None:
    scene, geometry = situation
    scene = msgspec.structs.replace(scene, view=View(rotation=scene.view.rotation))
    ni, nj, nk = (size - 0.5 for size in geometry.dims)
    corners = torch.cartesian_prod(torch.tensor([-0.5, ni]), torch.tensor([-0.5, nj]), torch.tensor([-0.5, nk]))
    off = mapping.on_screen(corners.double(), scene, geometry) - torch.tensor(
        [(scene.image.width - 1) / 2, (scene.image.height - 1) / 2]
    )
    assert off.norm(dim=1).max() <= FIT_FRACTION * min(scene.image.width, scene.image.height) / 2 + DDA_DRIFT


@given(situations())
def test_screen_fields_span_the_bounding_sphere_in_any_view(situation: tuple[Scene, Geometry]) -> None:
    scene, geometry = situation
    plan = plan_frame(scene, geometry, Step.C)
    samples = mapping.samples_of(scene, geometry, plan)
    middle = (torch.tensor(geometry.dims).double() - 1) / 2
    steps = mapping.steps_on_screen(scene, geometry)
    radius = bounding_radius(geometry) / geometry.reference_spacing * resolved_zoom(scene, geometry)
    expected = ((samples.indices - middle) @ steps.T + radius) * (256 / (2 * radius))
    for axis, dda in enumerate(plan.screen_index):
        fixed = dda.origin + (2 * samples.indices * torch.tensor(dda.half_steps)).sum(dim=1)
        assert (fixed.double() / 2**32 - expected[:, axis]).abs().max() <= DDA_DRIFT
        assert 0 <= int(fixed.min() >> 32) <= int(fixed.max() >> 32) <= 255


@given(st.floats(1e-30, 1e30))
def test_cube_root_is_the_cube_root(value: float) -> None:
    assert matrices.cube_root(value) == pytest.approx(math.cbrt(value), rel=ROUNDING)


@given(situations())
def test_inverse_undoes_a_volume_s_matrix(situation: tuple[Scene, Geometry]) -> None:
    matrix = situation[1].index_to_physical
    product = matrices.product(matrix, matrices.inverse(matrix))
    assert torch.allclose(torch.tensor(product, dtype=torch.float64), torch.eye(3).double(), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("size", [5e-324, 1e-200, 1.0, 1e200, 1.7e308])
def test_directions_and_rotations_may_have_any_length(size: float) -> None:
    assert matrices.normalised((0.0, -size, 0.0)) == (0.0, -1.0, 0.0)
    assert matrices.rotation_from_quaternion((0.0, 0.0, 0.0, size)) == matrices.IDENTITY
