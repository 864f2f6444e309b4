"""A frame's numbers: the same from the same scene, opacity for the path through a block, and what is refused."""

import itertools
import math

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import mapping, shading
from support.scenes.arbitrary import plain_scene, situations
from tolerances import ROUNDING
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Order, Refine, Scene, Shading, View
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.frame_plan import CELLS_IN_A_SHEET, FramePlan, Reach, opacity_exponent, plan_frame
from volsplat.protocol.rules.grid_on_screen import grid_on_screen
from volsplat.protocol.rules.levels import Thinning, own_resolution
from volsplat.protocol.rules.refinement import PAPER_STEPS, active_shading

NEAREST_STEPS = (Step.A, Step.B, Step.C)


def thickness_of_a_layer(scene: Scene, geometry: Geometry, axis: int) -> float:
    """What a ray runs inside one layer of the grid, in reference spacings: no kernel, no cells, just geometry."""
    steps = mapping.steps_on_screen(scene, geometry)
    toward = torch.linalg.inv(steps)[axis, 2].abs()  # of this index, per pixel of depth
    return float(1 / toward) / grid_on_screen(scene, geometry).zoom


@given(situations(), st.sampled_from(Step))
def test_a_plan_arrives_as_it_was_sent(situation: tuple[Scene, Geometry], step: Step) -> None:
    plan = plan_frame(*situation, step)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(plan), type=FramePlan) == plan


@given(situations(), st.sampled_from(NEAREST_STEPS))
def test_cells_of_all_sheets_add_up_to_the_path_through_the_volume(
    situation: tuple[Scene, Geometry], step: Step
) -> None:
    scene, geometry = situation
    plan, grid = plan_frame(scene, geometry, step), grid_on_screen(scene, geometry)
    sheet_axis = plan.traversal.axes[0]
    total = 0.0
    for n in range(plan.visits[sheet_axis].count):
        low, high = plan.visits[sheet_axis].block(n)
        block = [1, 1, 1]
        block[sheet_axis] = high - low
        exponent = opacity_exponent(grid, Reach.CELL, plan.traversal.axes, plan.stride, (block[0], block[1], block[2]))
        total += CELLS_IN_A_SHEET * exponent
    layers = plan.bounds.size[sheet_axis]
    assert total == pytest.approx(layers * thickness_of_a_layer(scene, geometry, sheet_axis), rel=ROUNDING)


@given(situations(), st.sampled_from(NEAREST_STEPS))
def test_nearest_pixels_carry_the_volume_of_all_blocks(situation: tuple[Scene, Geometry], step: Step) -> None:
    scene, geometry = situation
    plan, grid = plan_frame(scene, geometry, step), grid_on_screen(scene, geometry)
    sizes = mapping.samples_of(scene, geometry, plan).block_sizes.tolist()
    total = math.fsum(
        opacity_exponent(grid, Reach.PIXEL, plan.traversal.axes, plan.stride, (ni, nj, nk)) for ni, nj, nk in sizes
    )
    assert total == pytest.approx(plan.bounds.voxels * grid.zoom**2, rel=ROUNDING)


@given(situations(), st.sampled_from((1, 2, 4)))
def test_footprints_carry_thickness_in_their_weights_so_only_the_stride_counts(
    situation: tuple[Scene, Geometry], stride: int
) -> None:
    assert opacity_exponent(grid_on_screen(*situation), Reach.FOOTPRINT, (2, 1, 0), stride, (1, 2, 3)) == stride


@given(situations(), st.sampled_from(PAPER_STEPS))
def test_each_sample_has_the_exponent_of_its_block(situation: tuple[Scene, Geometry], step: Step) -> None:
    plan, grid = plan_frame(*situation, step), grid_on_screen(*situation)
    samples = mapping.samples_of(*situation, plan)
    expected = [
        opacity_exponent(grid, plan.reach, plan.traversal.axes, plan.stride, (ni, nj, nk))
        for ni, nj, nk in samples.block_sizes.tolist()
    ]
    assert shading.opacity_exponents(plan, samples.indices).tolist() == expected


@given(situations(largest=30), st.sampled_from(NEAREST_STEPS), st.floats(0.02, 1.0))
def test_one_nearest_pixel_leaves_no_hole(situation: tuple[Scene, Geometry], step: Step, zoom: float) -> None:
    """Where the plan says one pixel a sample, every pixel that a shell covers has a sample of it."""
    scene, geometry = situation
    scene = msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=zoom))
    plan = plan_frame(scene, geometry, step)
    if plan.reach != Reach.PIXEL:
        return
    # A unit square around a point holds the middles of all voxels that a ray through the point passes through.
    steps = mapping.steps_on_screen(scene, geometry)[:2] * plan.stride
    corners = torch.tensor(list(itertools.product((-0.5, 0.5), repeat=3)), dtype=torch.float64)
    assert (corners @ steps.T).abs().max() <= 0.5 + ROUNDING


@pytest.mark.parametrize("zoom", [0.25, 0.9])
def test_small_voxels_go_to_the_nearest_pixel_and_large_ones_fill_their_cell(zoom: float) -> None:
    scene = plain_scene(view=View(zoom=zoom))
    assert plan_frame(scene, Geometry((8, 8, 8)), Step.C).reach == Reach.PIXEL
    closer = plain_scene(view=View(zoom=1.01))
    assert plan_frame(closer, Geometry((8, 8, 8)), Step.C).reach == Reach.CELL


def test_steps_visit_and_reconstruct_as_in_the_paper() -> None:
    geometry = Geometry((16, 16, 16))
    plans = [plan_frame(plain_scene(view=View(zoom=4.0)), geometry, step) for step in PAPER_STEPS]
    assert [plan.stride for plan in plans] == [4, 2, 1, 1, 1, 1]
    assert [plan.reach for plan in plans] == [Reach.CELL] * 3 + [Reach.FOOTPRINT] * 3


def test_lighting_begins_at_e_with_diffuse_and_at_f_with_specular() -> None:
    scene = plain_scene()
    active = [active_shading(scene, step) for step in PAPER_STEPS]
    assert [part.diffuse for part in active] == [False] * 4 + [True, True]
    assert [part.specular for part in active] == [False] * 5 + [True]
    assert all(part.emitted for part in active)


def test_lighting_begins_earlier_when_asked_or_when_nothing_is_emitted() -> None:
    from_c = msgspec.structs.replace(plain_scene(), refine=Refine(lit_from=PaperStep.C))
    assert [active_shading(from_c, step).diffuse for step in Step] == [False] * 2 + [True] * 5
    black = ColourTable(points=((0.0, (0.0, 0.0, 0.0)),))
    tables = msgspec.structs.replace(plain_scene().tables, emit=black)
    assert active_shading(msgspec.structs.replace(plain_scene(), tables=tables), Step.A).diffuse
    unlit = msgspec.structs.replace(plain_scene(), shading=Shading(emitted=False, diffuse=False))
    assert not active_shading(unlit, Step.F).diffuse


@pytest.mark.parametrize("frozen_alpha", [0.0, -0.5, 1.0, math.nan])
def test_pixels_may_be_frozen_earlier_than_as_a_rule_but_not_later(frozen_alpha: float) -> None:
    geometry = Geometry((8, 8, 8))
    planned = [
        plan_frame(plain_scene(), geometry, Step.F, own_resolution(geometry, Step.F, Thinning(frozen_alpha=alpha)))
        for alpha in (FROZEN_ALPHA, 0.75)
    ]
    assert [plan.frozen_alpha for plan in planned] == [FROZEN_ALPHA, 0.75]
    with pytest.raises(ValueError, match="pixels are frozen from an alpha"):
        msgspec.structs.replace(planned[0], frozen_alpha=frozen_alpha)
    with pytest.raises(ValueError, match="slabs are drawn until"):
        msgspec.structs.replace(plan_frame(plain_scene(), geometry, Step.G), frozen_alpha=0.75)


@pytest.mark.parametrize(
    ("low", "high", "axis"),
    [((0, 0, 0), (9, 8, 8), "i"), ((0, -1, 0), (-1, -1, -1), "j"), ((0, 0, 5), (8, 8, 5), "k")],
)
def test_bounds_outside_the_volume_are_refused_by_axis(
    low: tuple[int, int, int], high: tuple[int, int, int], axis: str
) -> None:
    with pytest.raises(ValueError, match=f"bounds on {axis} are"):
        plan_frame(plain_scene(bounds=Bounds(low=low, high=high)), Geometry((8, 8, 8)), Step.A)


def test_bounds_of_minus_one_reach_to_the_end() -> None:
    plan = plan_frame(plain_scene(bounds=Bounds(low=(1, 0, 2), high=(-1, 4, -1))), Geometry((8, 9, 10)), Step.A)
    assert plan.bounds == Box((1, 0, 2), (8, 4, 10))


def test_view_too_far_out_for_the_fixed_point_is_refused() -> None:
    scene = plain_scene(view=View(zoom=256.0, center=(1e8, 0.0, 0.0)))
    with pytest.raises(ValueError, match="lower the zoom"):
        plan_frame(scene, Geometry((8, 8, 8)), Step.A)


@given(situations(), st.sampled_from(PAPER_STEPS), st.sampled_from(Order))
def test_a_chosen_order_is_kept_and_an_open_one_is_decided(
    situation: tuple[Scene, Geometry], step: Step, order: Order
) -> None:
    scene, geometry = situation
    plan = plan_frame(msgspec.structs.replace(scene, order=order), geometry, step)
    assert plan.order in TRAVERSAL_ORDERS
    assert order in (plan.order, Order.FASTEST)


@pytest.mark.parametrize(
    ("opacity", "fastest"),
    [(0.001, Order.BACK_TO_FRONT), (0.5, Order.FRONT_TO_BACK), (1.0, Order.FRONT_TO_BACK)],
)
def test_the_fastest_order_is_front_to_back_where_something_can_be_hidden(opacity: float, fastest: Order) -> None:
    scene = plain_scene(opacity=opacity, order=Order.FASTEST)
    assert plan_frame(scene, Geometry((64, 64, 64)), Step.F).order == fastest


def test_plan_depends_on_order_only_in_its_traversal() -> None:
    one = plan_frame(plain_scene(order=Order.BACK_TO_FRONT), Geometry((8, 8, 8)), Step.C)
    two = plan_frame(plain_scene(order=Order.FRONT_TO_BACK), Geometry((8, 8, 8)), Step.C)
    assert msgspec.structs.replace(two, order=one.order, traversal=one.traversal) == one
