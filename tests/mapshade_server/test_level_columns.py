"""Columns of a level's voxels: which they are, and what is seen of them."""

import math
from itertools import pairwise, permutations, product

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from reference import level_columns
from support.scenes.level_packets import FACTORS, SIZES, as_packets, drawn_packets, halves
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames.level_light import LIGHT_STEPS
from volsplat.mapshade_server.held.level_columns import (
    AXES,
    AXIS_VOXELS,
    DIAGONAL_VOXELS,
    DIRECTIONS,
    LEAST_COLUMNS,
    NO_AXIS,
    Columns,
    Slant,
    columns_of,
    rows_within,
)
from volsplat.protocol.description.volume import Index

EXACT = 1e-9
ALONG_I, ALONG_J, ALONG_K = range(3)
SLANTS = st.builds(Slant, st.booleans(), st.booleans())


def entries(columns: Columns) -> NDArray[np.int32]:
    """The first voxel of each column or bundle, which is at its lower end."""
    return columns.voxels()[[0, *columns.ends[:-1].tolist()]]


def test_there_are_as_many_columns_as_memory_allows() -> None:
    dims = (160, 128, 150)
    found = columns_of(dims)
    assert [columns.direction for columns in found] == list(DIRECTIONS)
    for columns in found:
        rows = AXIS_VOXELS / 3 if columns.direction in AXES else DIAGONAL_VOXELS / 10
        assert 0.95 * rows <= len(columns.voxels()) <= 1.05 * rows
        different = {part.tobytes() for part in np.split(columns.voxels(), columns.ends[:-1])}
        assert LEAST_COLUMNS < len(different) <= columns.number < columns.every
        assert len(different) > 0.98 * columns.number  # some that enter side by side, in other orders, are one


def test_of_large_levels_there_are_still_some_columns() -> None:
    for columns in columns_of((700, 690, 710)):
        assert columns.number == pytest.approx(LEAST_COLUMNS, abs=2)


def test_along_axes_columns_are_spread_evenly() -> None:
    dims = (512, 300, 700)
    for columns in columns_of(dims)[:3]:
        first = entries(columns)
        axis = columns.direction.index(1)
        assert not first[:, axis].any() and len(columns.voxels()) == 4 * columns.number * dims[axis]
        for aside in {0, 1, 2} - {axis}:
            gaps = [after - before for before, after in pairwise([0, *sorted(first[:, aside].tolist()), dims[aside]])]
            assert max(gaps) <= max(2, 4 * dims[aside] / columns.number)


def test_along_diagonals_columns_are_as_dense_on_each_face_that_they_enter() -> None:
    for columns in columns_of((60, 40, 50))[3:]:
        inwards = entries(columns)
        for axis, along in enumerate(columns.direction):
            if along < 0:
                inwards[:, axis] = (60, 40, 50)[axis] - 1 - inwards[:, axis]
        axes = [axis for axis, along in enumerate(columns.direction) if along]
        on_faces = [float((inwards[:, axis] == 0).mean()) for axis in axes]
        sizes = [math.prod((60, 40, 50)) // (60, 40, 50)[axis] / columns.every for axis in axes]
        assert on_faces == pytest.approx(sizes, abs=0.05)


@given(dims=SIZES)
@example(dims=(1, 1, 1))
@example(dims=(1, 7, 3))
def test_columns_take_one_axis_after_the_other_from_end_to_end(dims: Index) -> None:
    """So small a level has all that there are."""
    for columns in columns_of(dims)[len(AXES) :]:
        axes = [axis for axis, along in enumerate(columns.direction) if along]
        orders = list(permutations(axes))
        assert columns.number == columns.every
        assert len(np.unique(columns.voxels(), axis=0)) == math.prod(dims)
        begin = 0
        for n, end in enumerate(columns.ends.tolist()):
            voxels = [tuple(voxel) for voxel in columns.voxels()[begin:end].tolist()]
            order = orders[n % len(orders)]
            assert any(
                voxels == level_columns.column(dims, columns.direction, voxel, order) for voxel in voxels[: len(axes)]
            )
            begin = end


@given(dims=SIZES)
@example(dims=(1, 1, 1))
@example(dims=(1, 7, 3))
def test_bundles_along_axes_are_four_columns_abreast_from_end_to_end(dims: Index) -> None:
    """So small a level has all that there are; at an odd end the outermost voxels are there twice."""
    for along, columns in enumerate(columns_of(dims)[: len(AXES)]):
        a, b = (axis for axis in range(3) if axis != along)
        assert columns.number == math.ceil(dims[a] / 2) * math.ceil(dims[b] / 2)
        assert columns.every == dims[a] * dims[b]
        assert len(np.unique(columns.voxels(), axis=0)) == math.prod(dims)
        for bundle in np.split(columns.voxels(), columns.ends[:-1]):
            low = bundle[0].tolist()
            assert low[along] == 0 and low[a] % 2 == low[b] % 2 == 0
            expected = []
            for at, beside_b, beside_a in product(range(dims[along]), range(2), range(2)):
                voxel = [at, at, at]
                voxel[a], voxel[b] = min(low[a] + beside_a, dims[a] - 1), min(low[b] + beside_b, dims[b] - 1)
                expected.append(voxel)
            assert bundle.tolist() == expected


@given(dims=SIZES, factors=FACTORS, seed=st.integers(0, 1000))
def test_rows_are_those_of_the_reference(dims: tuple[int, ...], factors: tuple[int, ...], seed: int) -> None:
    finer, coarser = drawn_packets(dims, seed), drawn_packets(halves(dims, factors), seed + 1)
    size = (coarser.shape[2], coarser.shape[1], coarser.shape[0])
    placed = rows_within(as_packets(finer), as_packets(coarser), (0, 0, 0), size)
    assert placed[:, 0].tolist() == list(range(len(placed)))
    rows = placed[:, 1:]
    ni, nj, nk = map(range, size)
    expected = {voxel: level_columns.row(finer, coarser, voxel) for voxel in product(ni, nj, nk)}
    for columns in columns_of(size):
        of_columns = rows[columns.begin : columns.end].tolist()
        for voxel, row in zip(columns.voxels().tolist(), of_columns, strict=True):
            i, j, k = voxel
            assert row == expected[i, j, k]


@given(dims=SIZES, seed=st.integers(0, 1000), cut=st.integers(1, 4))
def test_parts_of_a_level_give_the_rows_of_all_of_it(dims: tuple[int, ...], seed: int, cut: int) -> None:
    finer, coarser = as_packets(drawn_packets(dims, seed)), as_packets(drawn_packets(halves(dims), seed + 1))
    size = (coarser.shape[2], coarser.shape[1], coarser.shape[0])
    expected = rows_within(finer, coarser, (0, 0, 0), size)
    rows = np.zeros_like(expected)
    for low, high in ((0, cut), (cut, size[2])):
        if low < min(high, size[2]):
            of_part = rows_within(finer[2 * low : 2 * high], coarser[low:high], (0, 0, low), size)
            assert (np.diff(of_part[:, 0].astype(np.int64)) > 0).all()
            rows[of_part[:, 0]] = of_part
    assert np.array_equal(rows, expected)


@given(
    seed=st.integers(0, 1000),
    axis=st.sampled_from([None, ALONG_I, ALONG_J, ALONG_K]),
    from_high=st.booleans(),
    slant=SLANTS,
    factors=FACTORS,
)
@example(seed=1, axis=ALONG_K, from_high=True, slant=Slant(), factors=(2, 2, 1))
@example(seed=1, axis=None, from_high=True, slant=Slant(), factors=(2, 2, 1))
def test_what_is_seen_is_what_the_reference_sees(
    seed: int, axis: int | None, from_high: bool, slant: Slant, factors: Index
) -> None:
    random = torch.Generator().manual_seed(seed)
    rows = drawn_packets((20, 9), seed)
    rows[-1, 5:] = level_columns.BEYOND
    for child in range(8):
        if any((child >> along & 1) >= factor for along, factor in enumerate(factors)):
            rows[:, 1 + child] = level_columns.BEYOND
    finer, coarser = torch.rand((2, 65536, 6), dtype=torch.float64, generator=random)
    finer[::2, 0] = 0.0
    parts = [level_columns.seen(part, axis, from_high, finer, coarser, factors, slant) for part in (rows[:8], rows[8:])]
    expected = [first + second for first, second in zip(*parts, strict=True)]
    got = _kernels.seen_in_columns(
        as_packets(rows).data,
        np.array([8, 20]).data,
        NO_AXIS if axis is None else axis,
        from_high,
        slant,
        factors,
        finer.numpy().data,
        coarser.numpy().data,
    )
    assert [emitted for emitted, _, _ in got] == pytest.approx(expected[:2], rel=EXACT)
    for (_, codes, ours), theirs in zip(got, expected[2:], strict=True):
        reflected = np.zeros((32768, LIGHT_STEPS))
        reflected[np.asarray(codes)] = np.asarray(ours)
        assert np.abs(reflected - theirs.numpy()).max() <= EXACT
    assert expected[0] >= 0.0 and expected[1] > 0.0  # half of the finer opacities are 0, by chance all of them


@pytest.mark.parametrize("ends", [[4, 2, 12], [4, 10], [4, 16], []])
@pytest.mark.parametrize("axis", [NO_AXIS, ALONG_I])
def test_columns_that_do_not_end_with_their_rows_are_refused(ends: list[int], axis: int) -> None:
    with pytest.raises(ValueError, match="columns"):
        seen_of_nothing(ends, axis, (2, 2, 2))


def test_bundles_that_end_within_a_layer_are_refused() -> None:
    seen_of_nothing([6, 12], NO_AXIS, (2, 2, 2))
    with pytest.raises(ValueError, match="those of a bundle together"):
        seen_of_nothing([6, 12], ALONG_I, (2, 2, 2))


@pytest.mark.parametrize("factors", [(0, 2, 2), (2, 3, 2), (2, 2, -1)])
def test_levels_that_do_not_halve_are_refused(factors: Index) -> None:
    with pytest.raises(ValueError, match="one or two voxels along each axis"):
        seen_of_nothing([4, 12], ALONG_I, factors)


def seen_of_nothing(ends: list[int], axis: int, factors: Index) -> None:
    looks = np.zeros((65536, 6))
    rows = np.zeros((12, 9), np.uint32)
    given = rows.data, np.array(ends, np.int64).data, axis, True, (True, True), factors, looks.data, looks.data
    _kernels.seen_in_columns(*given)
