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

COLUMN_VOXELS = 1 << 18  # of a level, some more where columns are long
ROW = 9  # a coarser packet, and the eight that it stands for, i fastest
BEYOND = np.uint32(0xFFFFFFFF)  # in the place of a voxel beyond the volume, or a second one if an axis is whole

GOLDEN_PART = 40503  # of 2^16, the golden ratio: places follow each other evenly, however many there are
GOLDEN_BITS = 16

Rows = NDArray[np.uint32]  # (n, ROW), column by column from the lower end, those along i first, then j, then k
Places = NDArray[np.int64]
Looks = NDArray[np.float64]  # (65536, 7), see seen_in_columns


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


class Reflected(NamedTuple):
    """What multiplies the light on some directions."""

    codes: NDArray[np.int64]  # of the directions
    by_step: NDArray[np.float64]  # of the light, for each code: (n, 4)


class Seen(NamedTuple):
    """From one end of the columns along an axis, for as much of the level as there are columns."""

    emitted: tuple[float, float]  # by the finer level's voxels, and by the level's own
    reflected: tuple[Reflected, Reflected]  # likewise


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
        inside, aside = _within(columns, coarser.shape, low)
        depth = coarser.shape[2 - columns.axis]
        first = columns.begin + inside * columns.depth + low[columns.axis]
        places.append((first[:, None] + np.arange(depth)).reshape(-1))
        rows.append(_rows(finer, coarser, columns.axis, aside).reshape(-1, ROW))
    return np.concatenate(places), np.concatenate(rows)


def _within(columns: Columns, shape: tuple[int, ...], low: Index) -> tuple[Places, list[Places]]:
    """Which columns pass through a box, and where they are on its two other axes."""
    others = [axis for axis in range(3) if axis != columns.axis]
    aside = [places - low[axis] for places, axis in zip(columns.aside, others, strict=True)]
    hit = [(0 <= places) & (places < shape[2 - axis]) for places, axis in zip(aside, others, strict=True)]
    inside = np.flatnonzero(hit[0] & hit[1])
    return inside, [places[inside] for places in aside]


def _rows(finer: Rows, coarser: Rows, axis: int, aside: list[Places]) -> Rows:
    """Those of whole columns through a box: (columns, depth, ROW)."""
    rows = np.full((len(aside[0]), coarser.shape[2 - axis], ROW), BEYOND, np.uint32)
    rows[..., 0] = _columns(coarser, axis, aside)
    factors = [1 if fine == coarse else 2 for fine, coarse in zip(finer.shape[::-1], coarser.shape[::-1], strict=True)]
    for child in range(8):
        sides = [child >> along & 1 for along in range(3)]
        if any(side >= factor for side, factor in zip(sides, factors, strict=True)):
            continue
        i, j, k = (slice(side, None, factor) for side, factor in zip(sides, factors, strict=True))
        voxels = finer[k, j, i]  # one fewer at an odd end
        others = [size for along, size in enumerate(voxels.shape[::-1]) if along != axis]
        there = np.logical_and(*(places < size for places, size in zip(aside, others, strict=True)))
        children = _columns(voxels, axis, [places[there] for places in aside])
        rows[there, : children.shape[1], 1 + child] = children
    return rows


def _columns(voxels: Rows, axis: int, aside: list[Places]) -> Rows:
    """The voxels (k, j, i) of columns along an axis: (columns, depth)."""
    first, second = aside
    return np.moveaxis(voxels, 2 - axis, 2)[second, first]


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
        of_levels = _kernels.seen_in_columns(
            rows, columns.depth, axis, from_high, layers, places, finer.data, coarser.data
        )
        (finer_emitted, *of_finer), (coarser_emitted, *of_coarser) = of_levels
        reflected = (Reflected(*map(np.asarray, of_finer)), Reflected(*map(np.asarray, of_coarser)))
        return Seen((finer_emitted, coarser_emitted), reflected)
