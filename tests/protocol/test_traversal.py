"""The order of visits: right for every view and matrix, each order the other's reverse, blocks that tile the bounds."""

import itertools
from random import Random

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from reference import mapping
from support.scenes.arbitrary import plain_scene, quaternion_to, situations
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Order, Scene, View
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.levels import Resolution
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.traversal import Traversal, traversal_of, visits_of

# So unequal that within a 5x6x7 cube no two steps of one loop make up for one of the next outer loop.
UNEQUAL = (1.0, 0.1, 0.01)
ROUNDED = 1e-4  # of a cosine, by the distance of layers in fixed point


def other(order: Order) -> Order:
    return Order.FRONT_TO_BACK if order == Order.BACK_TO_FRONT else Order.BACK_TO_FRONT


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
@pytest.mark.parametrize("axes", list(itertools.permutations(range(3))))
def test_each_of_48_traversals_of_a_cube_is_a_sort_by_depth(
    axes: tuple[int, int, int], signs: tuple[int, int, int], order: Order
) -> None:
    toward = [0.0, 0.0, 0.0]
    for axis, sign, size in zip(axes, signs, UNEQUAL, strict=True):
        toward[axis] = sign * size
    geometry = Geometry((5, 6, 7))
    scene = plain_scene(view=View(rotation=quaternion_to((toward[0], toward[1], toward[2]))), order=order)
    plan = plan_frame(scene, geometry, Step.C)
    assert plan.traversal.axes == axes
    visited = mapping.samples_of(scene, geometry, plan).indices
    every = torch.cartesian_prod(torch.arange(5), torch.arange(6), torch.arange(7))
    depth = every.double() @ torch.tensor(toward, dtype=torch.float64)
    assert torch.equal(visited, every[torch.argsort(depth, descending=order == Order.FRONT_TO_BACK)])


@given(situations(), st.sampled_from((Step.C, Step.D)), st.randoms(use_true_random=False))
def test_of_two_voxels_on_one_ray_the_farther_is_visited_first_back_to_front(
    situation: tuple[Scene, Geometry], step: Step, random: Random
) -> None:
    scene, geometry = situation
    scene = msgspec.structs.replace(scene, order=Order.BACK_TO_FRONT, bounds=plain_scene().bounds)
    samples = mapping.samples_of(scene, geometry, plan_frame(scene, geometry, step))
    ordinal = {tuple(index): n for n, index in enumerate(samples.indices.tolist())}
    to_viewer = torch.zeros((3, 1), dtype=torch.float64)
    to_viewer[2] = 1
    ray = torch.linalg.solve(mapping.steps_on_screen(scene, geometry), to_viewer).flatten()
    ray = ray / ray.abs().max()
    for far in random.sample(list(ordinal), min(20, len(ordinal))):
        start = torch.tensor([index + random.uniform(-0.49, 0.49) for index in far], dtype=torch.float64)
        near = tuple(torch.round(start + random.uniform(0, max(geometry.dims)) * ray).long().tolist())
        if near in ordinal:
            assert ordinal[near] >= ordinal[far]


@given(situations(), st.sampled_from(PAPER_STEPS))
def test_front_to_back_is_the_exact_reverse_of_back_to_front(situation: tuple[Scene, Geometry], step: Step) -> None:
    scene, geometry = situation
    reverse = msgspec.structs.replace(scene, order=other(scene.order))
    one = mapping.samples_of(scene, geometry, plan_frame(scene, geometry, step))
    two = mapping.samples_of(reverse, geometry, plan_frame(reverse, geometry, step))
    assert torch.equal(one.indices, two.indices.flip(0))
    assert torch.equal(one.lattice, two.lattice.flip(0))
    assert torch.equal(one.blocks, two.blocks.flip(0))


def test_of_equal_magnitudes_k_comes_before_j_before_i() -> None:
    for signs in itertools.product((1, -1), repeat=3):
        assert traversal_of((5 * signs[0], 5 * signs[1], 5 * signs[2]), Order.BACK_TO_FRONT).axes == (2, 1, 0)
    assert traversal_of((0, 0, 0), Order.BACK_TO_FRONT).axes == (2, 1, 0)
    assert traversal_of((-7, 3, 3), Order.BACK_TO_FRONT).axes == (0, 2, 1)


def test_a_zero_delta_counts_as_positive() -> None:
    assert traversal_of((0, 0, -1), Order.BACK_TO_FRONT) == Traversal((2, 1, 0), (False, True, True))
    assert traversal_of((0, 0, -1), Order.FRONT_TO_BACK) == Traversal((2, 1, 0), (True, False, False))


@pytest.mark.parametrize("direction", [(1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (0.0, 1.0, 1.0), (1.0, 0.0, -1.0)])
def test_views_along_a_diagonal_are_ties(direction: tuple[float, float, float]) -> None:
    scene = plain_scene(view=View(rotation=quaternion_to(direction), zoom=1.37))
    axes = plan_frame(scene, Geometry((9, 9, 9), origin=(1.0, 2.0, 3.0)), Step.C).traversal.axes
    assert axes == tuple(sorted((2, 1, 0), key=lambda axis: direction[axis] == 0))


def test_thick_slices_seen_almost_along_them_are_not_taken_for_sheets() -> None:
    """Depth changes more by one slice 5 away than by one voxel, yet a ray crosses many voxels in each slice."""
    tilted_gantry = ((1.0, 0.0, 0.0), (0.0, 1.0, 2.5), (0.0, 0.0, 4.3))
    along_j = View(rotation=quaternion_to((0.0, 1.0, 0.0)))
    assert plan_frame(plain_scene(view=along_j), Geometry((9, 9, 9), tilted_gantry), Step.C).traversal.axes[0] == 1


@given(situations())
def test_sheets_of_footprints_are_the_layers_that_face_the_viewer_most(situation: tuple[Scene, Geometry]) -> None:
    scene, geometry = situation
    steps = mapping.steps_on_screen(scene, geometry)
    facing = [
        abs(float(torch.nn.functional.normalize(torch.linalg.cross(steps[:, one], steps[:, other]), dim=0)[2]))
        for one, other in ((1, 2), (2, 0), (0, 1))
    ]
    sheet, row, sample = plan_frame(scene, geometry, Step.D).traversal.axes
    assert facing[sheet] >= facing[row] - ROUNDED >= facing[sample] - 2 * ROUNDED


def test_footprints_of_a_level_have_the_sheets_that_the_volume_has() -> None:
    """Its voxels are cubes where those of the volume are twice as long along k: a ray passes most on another axis."""
    geometry = Geometry((8, 8, 4), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2.0)))
    level = Geometry((4, 4, 4), ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0)))
    scene = plain_scene(view=View(rotation=quaternion_to((0.1, 0.6, 0.7))))
    resolutions = [Resolution(n, grid, 1) for n, grid in enumerate((geometry, level))]
    by_step = {
        step: [plan_frame(scene, geometry, step, drawn).traversal.axes for drawn in resolutions]
        for step in (Step.C, Step.F)
    }
    assert by_step == {Step.C: [(1, 2, 0), (2, 1, 0)], Step.F: [(2, 1, 0), (2, 1, 0)]}


@given(st.integers(0, 50), st.integers(1, 40), st.sampled_from((1, 2, 4)))
def test_visits_are_the_same_indices_of_the_whole_grid_whatever_the_bounds(low: int, size: int, stride: int) -> None:
    visits = visits_of(low, low + size, stride)
    visited = [visits.index(n) for n in range(visits.count)]
    of_the_grid = [index for index in range(low, low + size) if index % stride == stride // 2]
    assert visited == (of_the_grid or [(2 * low + size) // 2])


@given(st.integers(0, 50), st.integers(1, 40), st.sampled_from((1, 2, 4)))
def test_blocks_partition_the_bounds_and_hold_their_visit(low: int, size: int, stride: int) -> None:
    visits = visits_of(low, low + size, stride)
    covered: list[int] = []
    for n in range(visits.count):
        start, stop = visits.block(n)
        assert start <= visits.index(n) < stop
        covered.extend(range(start, stop))
    assert covered == list(range(low, low + size))


def test_visited_samples_of_every_step_partition_the_bounds() -> None:
    dims: Index = (9, 7, 6)
    for step in PAPER_STEPS:
        scene = plain_scene(view=View(rotation=(0.1, 0.4, -0.2, 0.8)))
        samples = mapping.samples_of(scene, Geometry(dims), plan_frame(scene, Geometry(dims), step))
        assert int(samples.block_sizes.prod(dim=1).sum()) == 9 * 7 * 6
