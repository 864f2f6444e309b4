"""Levels of a volume: where their grids lie, which one a step takes, and that pictures of them agree."""

import math
from itertools import pairwise
from random import Random

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from reference.level_render import render_level
from support.scenes.arbitrary import geometries, plain_scene, quaternion_to
from support.scenes.partitions import cut, handed_out
from support.scenes.phantoms import QUANTISATION, shaded_scene, shells
from support.scenes.rays import constant, crossing
from support.scenes.rendering import rendered
from tolerances import MIDDLE_OF_FOOTPRINT, ONE_LEVEL, STRIDES
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.prepare.halving import halved
from volsplat.mapshade_server.prepare.layout import halved_geometry
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Order, Reconstruction, Shading, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules import levels
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.levels import Resolution, Thinning, own_resolution, resolution_of

OBLIQUE = (0.2, 0.3, 0.1, 0.9)
SIDES: list[Vector] = [(0.0, 0.0, 1.0), (0.3, 0.2, 1.0), (0.5, -0.4, -0.8)]


def halvings(geometry: Geometry, count: int) -> list[Geometry]:
    """A volume and its next coarser levels."""
    made = [geometry]
    for _ in range(count):
        made.append(halved_geometry(made[-1]))
    return made


def means(values: Tensor, grids: list[Geometry]) -> Tensor:
    """The values of the last of these levels."""
    made = values.numpy()
    for finer, coarser in pairwise(grids):
        made = halved(made, levels.factors_of(finer, coarser))
    return torch.from_numpy(np.ascontiguousarray(made, dtype=np.float64))


@given(geometries(), st.integers(0, 4), st.tuples(*[st.floats(-5, 20)] * 3))
def test_a_point_lies_at_one_place_whatever_the_level(geometry: Geometry, count: int, point: Vector) -> None:
    level = halvings(geometry, count)[-1]
    there = level.physical(levels.point_at_level(point, levels.factors_of(geometry, level)))
    assert there == pytest.approx(geometry.physical(point), rel=1e-9, abs=1e-6 * max(geometry.spacing))


@given(geometries(), st.integers(0, 4), st.integers(0, 10), st.integers(0, 2**32))
def test_parts_of_a_volume_partition_every_level(geometry: Geometry, count: int, cuts: int, seed: int) -> None:
    level = halvings(geometry, count)[-1]
    factors = levels.factors_of(geometry, level)
    held = torch.zeros(tuple(reversed(level.dims)), dtype=torch.int64)
    for box in cut(geometry.box, Random(seed), cuts):
        (i0, j0, k0), (i1, j1, k1) = levels.share_at_level(box, factors)
        held[k0:k1, j0:j1, i0:i1] += 1
    assert torch.all(held == 1)


@given(geometries(), st.integers(0, 3))
def test_the_middle_of_a_level_s_voxel_is_one_of_its_own(geometry: Geometry, count: int) -> None:
    level = halvings(geometry, count)[-1]
    factors = levels.factors_of(geometry, level)
    for corner in ((0, 0, 0), tuple(n - 1 for n in level.dims)):
        index = levels.index_in_volume((corner[0], corner[1], corner[2]), factors, geometry.dims)
        assert tuple(n // f for n, f in zip(index, factors, strict=True)) == corner
        assert all(0 <= n < size for n, size in zip(index, geometry.dims, strict=True))


def test_coarse_steps_take_coarse_levels_and_stride_where_there_are_none() -> None:
    grids = halvings(Geometry((64, 64, 64)), 2)

    def taken(base: int, striding: bool = False, among: list[Geometry] = grids) -> list[tuple[int, int]]:
        each = [resolution_of(step, among, base, striding) for step in (Step.A, Step.B, Step.C, Step.F)]
        return [(one.level, one.stride) for one in each]

    assert taken(0) == [(2, 1), (1, 1), (0, 1), (0, 1)]
    assert taken(1) == [(2, 2), (2, 1), (1, 1), (1, 1)]
    assert taken(2) == [(2, 4), (2, 2), (2, 1), (2, 1)]
    assert taken(0, striding=True) == [(0, 4), (0, 2), (0, 1), (0, 1)]
    assert taken(0, among=grids[:1]) == [(0, 4), (0, 2), (0, 1), (0, 1)]
    assert [list(levels.levels_drawn(grids, base)) for base in (0, 1, 2)] == [[0, 1, 2], [1, 2], [2]]


def test_the_finest_level_that_a_zoom_needs_has_voxels_of_at_most_a_pixel() -> None:
    """By the cube root of their volume: the first level halves one axis, the second two, the third all."""
    grids = halvings(Geometry((64, 64, 64), ((0.5, 0, 0), (0, 1.0, 0), (0, 0, 2.0))), 3)
    zooms = {4.0: 0, 1.0: 0, 0.8: 0, 0.79: 1, 0.51: 1, 0.5: 2, 0.26: 2, 0.25: 3, 0.01: 3}
    assert {zoom: levels.finest_needed(grids, zoom) for zoom in zooms} == zooms


@pytest.mark.parametrize("step", Step)
def test_the_volume_itself_is_level_0(step: Step) -> None:
    values, geometry = shells(14), Geometry((14, 14, 14), origin=(3.0, 0.1, 7.0))
    scene = shaded_scene(View(rotation=OBLIQUE, zoom=2.01, center=(6.3, 7.1, 5.9)), (40, 40))
    assert plan_frame(scene, geometry, step, own_resolution(geometry, step)) == plan_frame(scene, geometry, step)
    image = rendered(values, geometry, scene, step, resolution=own_resolution(geometry, step))
    assert torch.equal(image, rendered(values, geometry, scene, step))


@pytest.mark.parametrize("toward", SIDES)
@pytest.mark.parametrize(
    ("step", "opacity"), [(Step.A, 0.05), (Step.B, 0.05), (Step.C, 0.05), (Step.F, 0.02), (Step.F, 0.2)]
)
def test_a_slab_is_as_opaque_at_every_level(step: Step, opacity: float, toward: Vector) -> None:
    """With footprints if it is thin: there w A is less than opacity ** w (docs/how_it_works/properties.md)."""
    geometry = Geometry((64, 64, 8))
    scene = plain_scene(opacity, view=View(rotation=quaternion_to(toward), zoom=2.0), size=(40, 40))
    clear, _ = crossing(geometry, scene, margin=9.0)
    assert clear.any()
    finest = rendered(constant(geometry.dims), geometry, scene, Step.F)[clear]
    for number, level in enumerate(halvings(geometry, 2)):
        resolution = Resolution(number, level, stride=1)
        image = rendered(constant(level.dims), geometry, scene, step, resolution=resolution)[clear]
        assert (image - finest).abs().max() <= STRIDES


@pytest.mark.parametrize("toward", SIDES)
@pytest.mark.parametrize("thinning", [Thinning(sheets=2), Thinning(sheets=2, rows=2)])
def test_a_slab_is_as_opaque_without_some_sheets_and_rows(thinning: Thinning, toward: Vector) -> None:
    geometry = Geometry((64, 64, 8))
    scene = plain_scene(0.02, view=View(rotation=quaternion_to(toward), zoom=2.0), size=(40, 40))
    clear, _ = crossing(geometry, scene, margin=9.0)
    assert clear.any()
    whole = rendered(constant(geometry.dims), geometry, scene, Step.F)[clear]
    resolution = own_resolution(geometry, Step.F, thinning)
    thinned = rendered(constant(geometry.dims), geometry, scene, Step.F, resolution=resolution)[clear]
    assert (thinned - whole).abs().max() <= STRIDES


@pytest.mark.parametrize("layers", [1, 3, 16])
@pytest.mark.parametrize("thinning", [Thinning(sheets=2), Thinning(sheets=2, rows=2), Thinning(octaves=1)])
def test_a_voxel_is_seen_in_the_same_place_without_others(thinning: Thinning, layers: int) -> None:
    geometry, values = Geometry((16, 16, layers)), torch.zeros((layers, 16, 16), dtype=torch.uint8)
    values[{1: 0, 3: 1, 16: 5}[layers], 9, 7] = 255
    opac = ScalarTable(points=((0.0, 0.0), (1.0, 0.5)))
    scene = plain_scene(view=View(rotation=OBLIQUE, zoom=3.0), size=(60, 60))
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opac))

    def middle(resolution: Resolution) -> torch.Tensor:
        alpha = rendered(values, geometry, scene, Step.F, resolution=resolution)[..., 3].double()
        place = torch.arange(60.0, dtype=torch.float64)
        return torch.stack([(alpha.sum(dim=axis) * place).sum() for axis in (0, 1)]) / alpha.sum()

    whole = middle(own_resolution(geometry, Step.F))
    assert (middle(own_resolution(geometry, Step.F, thinning)) - whole).abs().max() <= MIDDLE_OF_FOOTPRINT


@pytest.mark.parametrize("thinning", [Thinning(frozen_alpha=0.9), Thinning(sheets=2, rows=2, frozen_alpha=0.9)])
def test_what_almost_opaque_pixels_hide_is_left_out_alike_by_all_servers(thinning: Thinning) -> None:
    """And what is left out is no more than they let through."""
    values, geometry = shells(24), Geometry((24, 24, 24))
    scene = shaded_scene(View(rotation=OBLIQUE, zoom=3.0), (80, 80))
    scene = msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK)
    resolution = own_resolution(geometry, Step.F, thinning)
    single = rendered(values, geometry, scene, Step.F, resolution=resolution, walkers=None)
    workers = [[Box((0, 0, 0), (24, 11, 24))], [Box((0, 11, 0), (24, 24, 24))]]
    for seed in range(3):
        shared = rendered(
            values, geometry, scene, Step.F, workers=workers, threads=3, arrival=Random(seed), resolution=resolution
        )
        assert torch.equal(shared, single)
    to_the_end = own_resolution(geometry, Step.F, thinning._replace(frozen_alpha=FROZEN_ALPHA))
    difference = rendered(values, geometry, scene, Step.F, resolution=to_the_end) - single
    assert 0.0 < difference.max() <= 1.0 - thinning.frozen_alpha


@pytest.mark.parametrize(
    ("thinning", "strides"),
    [
        (Thinning(), (1, 1, 1)),
        (Thinning(octaves=1), (2, 2, 2)),
        (Thinning(sheets=2), (2, 1, 1)),
        (Thinning(octaves=1, sheets=2, rows=2), (4, 4, 2)),
    ],
)
def test_what_is_left_out_is_counted_by_sheets_rows_and_samples(thinning: Thinning, strides: Index) -> None:
    geometry = Geometry((16, 16, 16))
    resolution = own_resolution(geometry, Step.F, thinning)
    assert resolution.strides == strides
    plan = plan_frame(plain_scene(view=View(zoom=2.0)), geometry, Step.F, resolution)
    assert math.prod(plan.counts) * thinning.one_in == geometry.box.voxels
    assert plan.counts == tuple(16 // stride for stride in strides)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize(("number", "between_slices"), [(1, 1.0), (2, 1.0), (2, 3.0)])
def test_a_level_s_image_is_the_same_for_any_partition(order: Order, number: int, between_slices: float) -> None:
    geometry = Geometry((13, 14, 11), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, between_slices)))
    values = shells(14)[:11, :, :13].contiguous()
    grids = halvings(geometry, number)
    level = grids[-1]
    coarse = means(values, grids)
    scene = shaded_scene(View(rotation=OBLIQUE, zoom=1.7), (40, 40), order)
    scene = msgspec.structs.replace(scene, bounds=Bounds(low=(1, 0, 3), high=(12, -1, 10)))
    random = Random(number)
    for step in (Step.A, Step.F):
        resolution = Resolution(number, level, stride=2 if step == Step.A else 1)
        expected = rendered(coarse, geometry, scene, step, resolution=resolution)
        assert expected.any()
        for workers in (1, 2, 3):
            boxes = [levels.share_at_level(box, levels.factors_of(geometry, level))
                     for box in cut(geometry.box, random, 5)]  # fmt: skip
            holdings = handed_out([box for box in boxes if min(box.size) > 0], workers, random)
            image = rendered(coarse, geometry, scene, step, workers=holdings, arrival=random, resolution=resolution)
            assert torch.equal(image, expected)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("between_slices", [1.0, 1.9, 3.0])
def test_voxels_that_reach_beyond_the_bounds_are_as_much_less_opaque_as_the_reference_s(
    order: Order, number: int, between_slices: float
) -> None:
    """Of cubes, and of thick slices, of which levels have all until voxels are as wide.

    With all offsets that positions have: those of the usual table cost up to 1.04/255 here.
    """
    geometry = Geometry((13, 14, 11), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, between_slices)))
    grids = halvings(geometry, number)
    level = grids[-1]
    coarse = means((shells(14)[:11, :, :13] + 90).clamp(max=255), grids)
    scene = shaded_scene(View(rotation=OBLIQUE, zoom=1.7, center=(6.1, 6.6, 5.2)), (40, 40), order)
    unlit, precise = Shading(diffuse=False, specular=False), Reconstruction(precise=True)
    scene = msgspec.structs.replace(scene, shading=unlit, reconstruction=precise)
    for low, high in (((0, 0, 0), geometry.dims), ((1, 0, 3), (12, 13, 10))):
        scene = msgspec.structs.replace(scene, bounds=Bounds(low=low, high=high))
        image = rendered(coarse, geometry, scene, Step.F, resolution=Resolution(number, level, stride=1))
        cube = SubCube.of_volume(level, coarse)
        cube.pack(QUANTISATION)
        packets = torch.from_numpy(np.asarray(memoryview(cube.packets)).astype(np.int64))
        expected, unaware = (
            render_level(packets, geometry, level, QUANTISATION, scene, partial) for partial in (True, False)
        )
        assert (image - expected).abs().max() <= ONE_LEVEL < (unaware - expected).abs().max()


def test_where_striding_gives_stripes_a_level_gives_the_mean() -> None:
    """Planes that are full and empty by turns: every second one alone is all or nothing."""
    geometry = Geometry((32, 32, 32))
    values = constant(geometry.dims, 0.0)
    values[:, :, 1::2] = 200.0
    grids = halvings(geometry, 2)
    scene = plain_scene(0.02, view=View(zoom=2.0), size=(40, 40))
    inside = (slice(10, 30), slice(10, 30), 3)
    strided = rendered(values, geometry, scene, Step.A)[inside]
    resolution = Resolution(2, grids[-1], stride=1)
    means_drawn = rendered(means(values, grids), geometry, scene, Step.A, resolution=resolution)[inside]
    solid = rendered(constant(geometry.dims), geometry, scene, Step.A)[inside]
    assert strided.max() == 0.0, "of the planes that stride 4 visits, none is full"
    assert (means_drawn - solid).abs().max() <= ONE_LEVEL


def test_edges_stay_those_of_the_volume() -> None:
    geometry = Geometry((13, 14, 11))
    level = halvings(geometry, 2)[-1]
    scene = plain_scene(0.0, view=View(rotation=OBLIQUE, zoom=2.0))
    scene = msgspec.structs.replace(scene, image=msgspec.structs.replace(scene.image, edges=True))
    image = rendered(constant(geometry.dims), geometry, scene, Step.F)
    coarse = rendered(constant(level.dims), geometry, scene, Step.A, resolution=Resolution(2, level, stride=1))
    assert image.any() and torch.equal(image, coarse)


def test_a_box_is_never_beyond_its_level() -> None:
    assert levels.bounds_at_level(Box((3, 0, 5), (4, 13, 6)), (2, 4, 4)) == Box((1, 0, 1), (2, 4, 2))
