"""The division of the grid into sub-cubes."""

from __future__ import annotations

import math
from itertools import combinations, product
from operator import add, lt
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.partitions import cut as cut_at_random
from tolerances import BALANCED
from volsplat.client.coordinator.shares.block_work import BlockWork
from volsplat.client.coordinator.shares.sub_cubes import Even, Share, Work, divided, divided_by_work
from volsplat.protocol.description.block_extremes import block_dims, block_size
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import Matrix, Vector

sides = st.integers(1, 12)
spacings = st.floats(0.1, 10)


@given(dims=st.tuples(sides, sides, sides), spacing=st.tuples(spacings, spacings, spacings), data=st.data())
def test_sub_cubes_partition_the_grid(
    dims: tuple[int, int, int], spacing: tuple[float, float, float], data: st.DataObject
) -> None:
    geometry = Geometry(dims, upright(spacing))
    boxes = divided(geometry, data.draw(st.integers(1, min(geometry.box.voxels, 40))))
    voxels = [voxel for box in boxes for voxel in voxels_of(box)]
    assert len(set(voxels)) == len(voxels) == geometry.box.voxels
    assert all(box.voxels > 0 for box in boxes)


def upright(spacing: Vector) -> Matrix:
    """The grid's steps along the physical axes."""
    x, y, z = spacing
    return ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))


def voxels_of(box: Box) -> list[tuple[int, int, int]]:
    (i0, j0, k0), (i1, j1, k1) = box.low, box.high
    return [(i, j, k) for k in range(k0, k1) for j in range(j0, j1) for i in range(i0, i1)]


def test_the_longest_edge_is_halved_in_length_not_in_voxels() -> None:
    boxes = divided(Geometry((64, 32, 16), upright((1.0, 1.0, 5.0))), 2)
    assert [box.size for box in boxes] == [(64, 32, 8), (64, 32, 8)]


@pytest.mark.parametrize("parts, size", [(2, (16, 8, 16)), (4, (8, 8, 16)), (8, (8, 8, 8))])
def test_of_equal_edges_k_is_halved_last(parts: int, size: tuple[int, int, int]) -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), parts)} == {size}


def test_there_are_no_more_sub_cubes_than_voxels() -> None:
    assert [box.voxels for box in divided(Geometry((2, 2, 2)), 9)] == [1] * 8


@pytest.mark.parametrize("parts, size", [(2, (16, 8, 16)), (4, (16, 8, 8)), (8, (16, 4, 8)), (32, (16, 2, 4))])
def test_rows_of_a_file_are_left_whole(parts: int, size: tuple[int, int, int]) -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), parts, (16, 1, 1))} == {size}


def test_what_comes_together_is_cut_where_nothing_else_is_left() -> None:
    assert {box.size for box in divided(Geometry((16, 16, 16)), 4, (16, 16, 16))} == {(8, 8, 16)}
    assert {box.size for box in divided(Geometry((16, 1, 1)), 4, (16, 1, 1))} == {(4, 1, 1)}


def test_whoever_is_faster_gets_more_and_nobody_more_than_fits() -> None:
    line = Geometry((100, 1, 1))
    assert [box.voxels for box in by_work(line, [Share(3.0), Share(1.0)])] == [75, 25]
    assert [box.voxels for box in by_work(line, [Share(3.0, most=60), Share(1.0)])] == [60, 40]
    assert [box.voxels for box in by_work(line, [Share(1.0), Share(3.0, most=60)])] == [40, 60]


def by_work(geometry: Geometry, shares: list[Share], work: Work | None = None) -> list[Box]:
    return divided_by_work(geometry, shares, (1, 1, 1), work or Even())


speeds = st.floats(1e-3, 1e3)
amounts = st.just(0.0) | st.floats(1e-9, 1e9)


@given(data=st.data(), dims=st.tuples(*[st.integers(1, 70)] * 3))
def test_boxes_partition_the_grid_for_any_work_and_speeds(data: st.DataObject, dims: tuple[int, int, int]) -> None:
    geometry = Geometry(dims)
    few = data.draw(st.lists(amounts, min_size=1, max_size=20))
    work = BlockWork(dims, [few[n * n % len(few)] for n in range(math.prod(block_dims(dims)))])
    shares = st.lists(st.builds(Share, speeds, st.integers(1, 2 * geometry.box.voxels)), min_size=1, max_size=16)
    boxes = by_work(geometry, data.draw(shares.filter(lambda shares: len(shares) <= geometry.box.voxels)), work)
    assert sum(box.voxels for box in boxes) == geometry.box.voxels
    assert all(min(box.size) > 0 for box in boxes)
    assert all(one.common(other) is None for one, other in combinations(boxes, 2))


profiles = st.lists(st.floats(1.0, 2.0), min_size=32, max_size=32)


@given(profiles=st.tuples(profiles, profiles, profiles), speeds=st.lists(st.floats(1.0, 2.0), min_size=2, max_size=16))
def test_boxes_are_balanced_to_within_their_layers_of_voxels(
    profiles: tuple[list[float], list[float], list[float]], speeds: list[float]
) -> None:
    """Where work is a product of what it is along each axis."""
    dims = (256, 256, 256)
    work = BlockWork(dims, [i * j * k for k, j, i in product(*reversed(profiles))])
    boxes = by_work(Geometry(dims), [Share(speed) for speed in speeds], work)
    seconds = [done / speed for done, speed in zip(work.of(boxes), speeds, strict=True)]
    assert max(seconds) <= BALANCED * sum(work.of(boxes)) / sum(speeds)


@given(data=st.data(), dims=st.tuples(*[st.integers(1, 70)] * 3))
def test_the_work_of_boxes_is_counted_and_corrected_by_their_voxels(
    data: st.DataObject, dims: tuple[int, int, int]
) -> None:
    grid = Geometry(dims)
    few = data.draw(st.lists(st.floats(0.1, 10.0), min_size=1, max_size=20))
    work = BlockWork(dims, [few[n * n % len(few)] for n in range(math.prod(block_dims(dims)))])
    boxes = by_work(grid, [Share()] * data.draw(st.integers(1, min(8, grid.box.voxels))))
    each, (whole,) = work.of(boxes), work.of([grid.box])
    assert sum(each) == pytest.approx(whole)
    n = data.draw(st.integers(0, len(boxes) - 1))
    for axis in range(3):
        layers = work.along(boxes[n], axis)
        assert layers[-1][0] == boxes[n].high[axis] and sum(done for _, done in layers) == pytest.approx(each[n])
    work.multiply(boxes, [3.0] * len(boxes))
    assert work.of(boxes) == pytest.approx([3 * one for one in each])
    block = block_size(dims)
    blocks = [Box((0, 0, 0), block), *([Box(block, dims)] if all(map(lt, block, dims)) else [])]
    each = work.of(blocks)
    work.multiply(blocks, [2.0, 5.0][: len(blocks)])
    assert work.of(blocks) == pytest.approx([2 * each[0], *(5 * one for one in each[1:])])


@given(cut=st.randoms(use_true_random=False), cuts=st.integers(1, 6))
def test_a_block_that_boxes_share_is_corrected_by_the_mean_of_its_voxels(cut: Random, cuts: int) -> None:
    grid = Box((0, 0, 0), (70, 60, 50))
    size = block_size(grid.high)
    boxes = cut_at_random(grid, cut, cuts)
    factors = [cut.uniform(0.1, 10.0) for _ in boxes]
    work = BlockWork(grid.high, np.ones(block_dims(grid.high)))
    blocks = [block_of(box.low, size, grid) for box in boxes]  # where boxes meet
    before = work.of(blocks)
    work.multiply(boxes, factors)
    for block, was, now in zip(blocks, before, work.of(blocks), strict=True):
        parts = [(factor, box.common(block)) for factor, box in zip(factors, boxes, strict=True)]
        mean = sum(factor * part.voxels for factor, part in parts if part is not None) / block.voxels
        assert now == pytest.approx(was * mean)


def block_of(voxel: Index, size: Index, grid: Box) -> Box:
    starts = [at - at % side for at, side in zip(voxel, size, strict=True)]
    i, j, k = [*zip(starts, map(min, map(add, starts, size), grid.high), strict=True)]
    return Box((i[0], j[0], k[0]), (i[1], j[1], k[1]))


@given(cut=st.randoms(use_true_random=False), cuts=st.integers(0, 6))
def test_boxes_have_in_common_what_they_are_not_without(cut: Random, cuts: int) -> None:
    grid = Box((0, 0, 0), (9, 8, 7))
    first, second = cut_at_random(grid, cut, cuts), cut_at_random(grid, cut, cuts)
    one, other = first[0], second[-1]
    common, rest = one.common(other), one.without(other)
    parts = [*rest, *([common] if common else [])]
    voxels = [voxel for part in parts for voxel in voxels_of(part)]
    assert sorted(voxels) == sorted(voxels_of(one))
    assert set(voxels_of(one)) & set(voxels_of(other)) == set(voxels_of(common) if common else [])
    assert all(part.within(one) and part.within(grid) for part in parts)
    assert one.within(other) == (set(voxels_of(one)) <= set(voxels_of(other)))
    assert sorted(v for part in grid.without(*first[1:]) for v in voxels_of(part)) == sorted(voxels_of(one))
