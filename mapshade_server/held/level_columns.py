"""Columns of voxels of a coarser level, each voxel with those that it stands for: as many as tell what is seen of it.

Tables of a level are means over all voxels of a bin. What is seen are those in front, by a light that falls on each of
them. So a store has columns through the whole level along its three axes, spread evenly, in which both can be followed.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.rules.levels import factors_of, thickness_of

COLUMN_VOXELS = 1 << 16  # of a level, some more where columns are long
ROW = 9  # a coarser packet, and the eight that it stands for, i fastest
BEYOND = np.uint32(0xFFFFFFFF)  # in the place of a voxel beyond the volume, or a second one if an axis is whole

GOLDEN_PART = 40503  # of 2^16, the golden ratio: places follow each other evenly, however many there are
GOLDEN_BITS = 16

Rows = NDArray[np.uint32]  # (n, ROW), column by column from the lower end, those along i first, then j, then k
Places = NDArray[np.int64]
Looks = NDArray[np.float64]  # (65536, 3): a layer's optical depth, what it emits and reflects; see seen_in_columns


class Columns(NamedTuple):
    """All along one axis."""

    axis: int
    depth: int
    aside: tuple[Places, Places]  # where they are on the two other axes, the lower of these first
    begin: int  # of their rows

    @property
    def number(self) -> int:
        return len(self.aside[0])

    @property
    def end(self) -> int:
        return self.begin + self.number * self.depth


class Seen(NamedTuple):
    """From one end of the columns along an axis, for as much of the level as there are columns."""

    emitted: tuple[float, float]  # by the finer level's voxels, and by the level's own
    reflected: tuple[NDArray[np.float64], NDArray[np.float64]]  # likewise, by direction code: what multiplies the light


@lru_cache(maxsize=64)
def columns_of(dims: Index) -> tuple[Columns, Columns, Columns]:
    """Those of a level of so many voxels."""
    along_i = _along(dims, 0, 0)
    along_j = _along(dims, 1, along_i.end)
    return along_i, along_j, _along(dims, 2, along_j.end)


def _along(dims: Index, axis: int, begin: int) -> Columns:
    width, height = (size for other, size in enumerate(dims) if other != axis)
    count = min(max(COLUMN_VOXELS // 3 // dims[axis], 1), width * height)
    n = np.arange(count, dtype=np.int64)
    if count == width * height:
        return Columns(axis, dims[axis], (n % width, n // width), begin)
    across = (2 * n + 1) * width // (2 * count)
    return Columns(axis, dims[axis], (across, (n * GOLDEN_PART % (1 << GOLDEN_BITS)) * height >> GOLDEN_BITS), begin)


def rows_within(finer: Rows, coarser: Rows, low: Index, dims: Index) -> tuple[Places, Rows]:
    """Of a box of a level (k, j, i) whose lowest voxel is `low`: its voxels in columns, and which rows these are.

    `finer` are the packets that it stands for: two along each axis that is halved, fewer at an odd end.
    """
    places, rows = [], []
    for columns in columns_of(dims):
        inside, index = _voxels_within(columns, coarser.shape, low)
        depths = np.arange(coarser.shape[2 - columns.axis], dtype=np.int64) + low[columns.axis]
        places.append((columns.begin + inside[:, None] * columns.depth + depths).reshape(-1))
        rows.append(_rows(finer, coarser, index))
    return np.concatenate(places), np.concatenate(rows)


def _voxels_within(columns: Columns, shape: tuple[int, ...], low: Index) -> tuple[Places, tuple[Places, ...]]:
    """Which columns pass through a box, and the indices k, j, i of their voxels there."""
    others = [axis for axis in range(3) if axis != columns.axis]
    aside = [places - low[axis] for places, axis in zip(columns.aside, others, strict=True)]
    hit = [(0 <= places) & (places < shape[2 - axis]) for places, axis in zip(aside, others, strict=True)]
    inside = np.flatnonzero(hit[0] & hit[1])
    depth = shape[2 - columns.axis]
    along: dict[int, Places] = {columns.axis: np.tile(np.arange(depth, dtype=np.int64), len(inside))}
    for places, axis in zip(aside, others, strict=True):
        along[axis] = np.repeat(places[inside], depth)
    return inside, (along[2], along[1], along[0])


def _rows(finer: Rows, coarser: Rows, index: tuple[Places, ...]) -> Rows:
    rows = np.full((len(index[0]), ROW), BEYOND, np.uint32)
    rows[:, 0] = coarser[index]
    factors = [1 if fine == coarse else 2 for fine, coarse in zip(finer.shape, coarser.shape, strict=True)]
    for child in range(8):
        asides = [child >> axis & 1 for axis in (2, 1, 0)]
        if any(aside >= factor for aside, factor in zip(asides, factors, strict=True)):
            continue
        at = [factor * n + aside for n, factor, aside in zip(index, factors, asides, strict=True)]
        there = np.logical_and.reduce([n < size for n, size in zip(at, finer.shape, strict=True)])
        k, j, i = (n[there] for n in at)
        rows[there, 1 + child] = finer[k, j, i]
    return rows


class LevelColumns:
    """Those of one level."""

    def __init__(self, volume: Geometry, finer: Geometry, level: Geometry, rows: Rows) -> None:
        """`finer` is the level before. Raises ValueError for rows that are not this level's, and for other levels."""
        self._columns = columns_of(level.dims)
        if rows.shape != (self._columns[-1].end, ROW) or rows.dtype != np.uint32:
            raise ValueError(f"columns of a level of {level.dims} voxels are not of shape {rows.shape}")
        self.levels = (finer, level)
        self.thickness = (thickness_of(volume, finer), thickness_of(volume, level))
        self._factors = factors_of(finer, level)
        self._rows = rows

    def area(self, axis: int) -> float:
        """That one of those along an axis stands for, in voxels' sides of a cube."""
        level = self.levels[-1]
        others = [other for other in range(3) if other != axis]
        sides = (level.dims[other] * level.spacing[other] / level.reference_spacing for other in others)
        return math.prod(sides) / self._columns[axis].number

    def seen(self, axis: int, from_high: bool, finer: Looks, coarser: Looks) -> Seen:
        """From the upper or the lower end of an axis."""
        columns = self._columns[axis]
        layers = self._factors[axis]
        places = math.prod(self._factors) // layers
        rows = self._rows[columns.begin : columns.end].data
        of_finer, of_coarser, *reflected = _kernels.seen_in_columns(
            rows, columns.depth, axis, from_high, layers, places, finer.data, coarser.data
        )
        return Seen((of_finer, of_coarser), (np.asarray(reflected[0]), np.asarray(reflected[1])))
