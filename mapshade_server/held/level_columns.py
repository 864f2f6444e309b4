"""Columns of voxels of a coarser level, each voxel with those that it stands for: as many as tell what is seen of it.

Tables of a level are means over all voxels of a bin. What is seen are those in front, by a light that falls on each of
them. So a store has columns through the whole level in thirteen directions, spread evenly, in which both can be
followed: along its three axes, the diagonals of its faces and those of its cubes.

Along an axis there are bundles of four columns side by side. At one pixel a voxel a footprint mixes about as many
voxels of a sheet before the next sheet is seen through them; rays through single ones lose more of what is thin.

A column along a diagonal takes one axis after the other, in each order alike, and so goes through faces of voxels only.
One through corners would see every other layer of a slope, and find its voxels hidden.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import permutations
from math import factorial, prod
from typing import NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.levels import factors_of, thickness_of

AXIS_VOXELS = 1 << 20  # of a level, along all three
DIAGONAL_VOXELS = 1 << 20  # along all ten, and two or three voxels to a step
LEAST_COLUMNS = 256  # or bundles, in each direction, however long, if there are so many: fewer differ by chance
ABREAST = 2  # columns of a bundle, on each of the two axes across it
ROW = 9  # a coarser packet, and the eight that it stands for, i fastest
PLACED_ROW = 1 + ROW  # after its place among all rows
BEYOND = np.uint32(0xFFFFFFFF)  # in the place of a voxel beyond the volume, or a second one if an axis is whole

GOLDEN_PART = 40503  # of 2^16, the golden ratio: places follow each other evenly, however many there are
GOLDEN_BITS = 16

# What a column adds to i, j and k until it begins again with the first of its axes
AXES: tuple[Index, ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
DIAGONALS: tuple[Index, ...] = (
    *((0, 1, 1), (0, 1, -1), (1, 0, 1), (1, 0, -1), (1, 1, 0), (1, -1, 0)),
    *((1, 1, 1), (1, 1, -1), (1, -1, 1), (1, -1, -1)),
)
DIRECTIONS = AXES + DIAGONALS
NO_AXIS = -1  # of diagonals
LEVEL = -(2.0**-33)  # of a component towards the viewer, what a frame's walk takes for none
QUICK = 1  # zstd's level

Rows = NDArray[np.uint32]  # (n, ROW), column by column from the lower end, by DIRECTIONS
PlacedRows = NDArray[np.uint32]  # (n, PLACED_ROW), by their places
Places = NDArray[np.int64]
Voxels = NDArray[np.int32]  # (n, 3), or (3, n) where that is said: i, j, k
Looks = NDArray[np.float64]  # (65536, 6), see seen_in_columns


class Columns(NamedTuple):
    """All in one direction."""

    dims: Index  # of the level
    direction: Index
    first: Voxels  # where they enter, counted from the other end on axes along which they descend
    ends: Places  # of each column or bundle, among their voxels
    every: int  # how many columns there would be, side by side
    begin: int  # of their rows

    @property
    def number(self) -> int:
        return len(self.ends)

    @property
    def rows(self) -> int:
        return int(self.ends[-1])

    @property
    def end(self) -> int:
        return self.begin + self.rows

    def voxels(self) -> Voxels:
        """Of one column after the other."""
        voxels, _ = _followed(self.first, self.dims, self.direction)
        return voxels


@lru_cache(maxsize=16)
def columns_of(dims: Index) -> tuple[Columns, ...]:
    """Those of a level of so many voxels, by DIRECTIONS."""
    found: list[Columns] = []
    for direction in DIRECTIONS:
        found.append(_columns(dims, direction, found[-1].end if found else 0))
    return tuple(found)


def _columns(dims: Index, direction: Index, begin: int) -> Columns:
    axes = _axes(direction)
    rows, abreast = (AXIS_VOXELS // len(AXES), ABREAST) if direction in AXES else (DIAGONAL_VOXELS // len(DIAGONALS), 1)
    i, j, k = (size if axis in axes else -(-size // abreast) for axis, size in enumerate(dims))
    places = (i, j, k)
    count_of_faces = [prod(face) for face in _faces(places, axes)]
    entries = sum(count_of_faces)
    count = min(max(rows * entries // (len(axes) * abreast**2 * prod(places)), LEAST_COLUMNS), entries)
    first = np.concatenate(
        [
            _entries(places, axes, n, max(count * of_face // entries, 1))
            for n, of_face in enumerate(count_of_faces)
            if of_face
        ]
    )
    first *= abreast
    _, ends = _followed(first, dims, direction)
    return Columns(dims, direction, first, ends, sum(map(prod, _faces(dims, axes))), begin)


def _axes(direction: Index) -> list[int]:
    return [axis for axis, along in enumerate(direction) if along]


def _faces(dims: Index, axes: list[int]) -> Iterator[Index]:
    """Of the lower faces of a level, across each of these axes: how many voxels, each counted for the first only."""
    for n, across in enumerate(axes):
        i, j, k = (1 if axis == across else size - (axis in axes[:n]) for axis, size in enumerate(dims))
        yield (i, j, k)


def _entries(dims: Index, axes: list[int], face: int, count: int) -> Voxels:
    """The first voxels of `count` columns, spread evenly over one of the faces where they enter."""
    across, sizes = axes[face], list(_faces(dims, axes))[face]
    aside = [axis for axis in range(3) if axis != across]
    width, height = (sizes[axis] for axis in aside)
    n = np.arange(count, dtype=np.int64)
    if count == width * height:
        places = [n % width, n // width]
    else:
        places = [(2 * n + 1) * width // (2 * count), (n * GOLDEN_PART % (1 << GOLDEN_BITS)) * height >> GOLDEN_BITS]
    first = np.zeros((count, 3), np.int32)
    for axis, place in zip(aside, places, strict=True):
        first[:, axis] = place + (axis in axes[:face])
    return first


def _followed(first: Voxels, dims: Index, direction: Index) -> tuple[Voxels, Places]:
    """All voxels of the columns that enter there, and where each column ends.

    One after the other takes its axes in another order. It enters between two voxels of its diagonal, and leaves so.
    """
    axes = _axes(direction)
    if direction in AXES:
        return _bundles(first, dims, axes[0])
    rounds = min(dims[axis] for axis in axes) + 1
    steps = np.zeros((factorial(len(axes)), rounds, len(axes), 3), np.int32)
    for n, order in enumerate(permutations(axes)):
        for at, axis in enumerate(order):
            steps[n, :, at + 1 :, axis] = 1
        steps[n, ..., axes] += np.arange(-1, rounds - 1, dtype=np.int32)[:, None]
    of_orders = steps.reshape(len(steps), -1, 3)
    voxels = first[:, None] + of_orders[np.arange(len(first)) % len(of_orders)]
    there = ((voxels >= 0) & (voxels < dims)).all(axis=2)
    found = voxels[there]
    for axis in axes:
        if direction[axis] < 0:
            found[:, axis] = dims[axis] - 1 - found[:, axis]
    return found, np.cumsum(there.sum(axis=1), dtype=np.int64)


def _bundles(first: Voxels, dims: Index, along: int) -> tuple[Voxels, Places]:
    """Likewise of bundles along an axis: four voxels abreast, and the four after them. At an odd end of the level one
    is there twice."""
    aside = [axis for axis in range(3) if axis != along]
    steps = np.zeros((dims[along], ABREAST, ABREAST, 3), np.int32)
    steps[..., along] = np.arange(dims[along], dtype=np.int32)[:, None, None]
    steps[..., aside[0]] = np.arange(ABREAST, dtype=np.int32)
    steps[..., aside[1]] = np.arange(ABREAST, dtype=np.int32)[:, None]
    voxels = np.minimum(first[:, None] + steps.reshape(-1, 3), np.array(dims, np.int32) - 1)
    return voxels.reshape(-1, 3), np.arange(1, len(first) + 1, dtype=np.int64) * voxels.shape[1]


@lru_cache(maxsize=1)
def _voxels_of(dims: Index) -> Voxels:
    """All rows' voxels, axis by axis: (3, n)."""
    return np.concatenate([columns.voxels().T for columns in columns_of(dims)], axis=1)


def rows_within(finer: Rows, coarser: Rows, low: Index, dims: Index) -> PlacedRows:
    """Of a box of a level (k, j, i) whose lowest voxel is `low`: the rows of its voxels in columns.

    `finer` are the packets that it stands for: two along each axis that is halved, fewer at an odd end.
    """
    everywhere, size = _voxels_of(dims), coarser.shape[::-1]
    inside = np.ones(everywhere.shape[1], bool)
    for voxels, begin, length in zip(everywhere, low, size, strict=True):
        inside &= (voxels >= begin) & (voxels < begin + length)
    places = np.flatnonzero(inside)
    there = [voxels[places] - begin for voxels, begin in zip(everywhere, low, strict=True)]
    rows = np.full((len(places), PLACED_ROW), BEYOND, np.uint32)
    rows[:, 0] = places
    rows[:, 1] = _at(coarser, there)
    factors = [1 if fine == coarse else 2 for fine, coarse in zip(finer.shape[::-1], size, strict=True)]
    for child in range(8):
        sides = [child >> axis & 1 for axis in range(3)]
        if any(side >= factor for side, factor in zip(sides, factors, strict=True)):
            continue
        of_child = [factor * n + side for n, factor, side in zip(there, factors, sides, strict=True)]
        ends = (n < end for n, end in zip(of_child, finer.shape[::-1], strict=True))  # one fewer at an odd end
        within = np.flatnonzero(np.logical_and.reduce(list(ends)))
        rows[within, 2 + child] = _at(finer, [n[within] for n in of_child])
    return rows


def _at(packets: Rows, voxels: Sequence[NDArray[np.int32]]) -> Rows:
    i, j, k = voxels
    found: Rows = packets[k, j, i]
    return found


class Reflected(NamedTuple):
    """What multiplies the light on some directions."""

    codes: NDArray[np.int64]  # of the directions
    by_step: NDArray[np.float64]  # of the light, for each code: (n, 4)


class Seen(NamedTuple):
    """From one end of the columns in a direction, for as much of the level as there are columns."""

    emitted: tuple[float, float]  # by the finer level's voxels, and by the level's own
    reflected: tuple[Reflected, Reflected]  # likewise


class Slant(NamedTuple):
    """Whether of voxels abreast the upper ones are nearer to the viewer, on the two axes across an axis, the lower one
    first. As with a sheet's samples, those of which neither is come from the upper end.
    """

    first: bool = True
    second: bool = True


class Side(NamedTuple):
    """From where a level is seen along its columns."""

    number: int  # of DIRECTIONS
    slant: Slant
    from_high: bool  # whether the viewer is at their upper end
    share: float  # of a column or bundle in what is seen of the level


class LevelColumns:
    """Those of one level, in a third of their bytes until they are looked at, which is once for a scene's tables."""

    def __init__(self, volume: Geometry, finer: Geometry, level: Geometry, rows: Iterable[Rows]) -> None:
        """`finer` is the level before; of `rows` there are those of one direction after the other, by DIRECTIONS.

        Raises ValueError for rows that are not this level's, and for other levels.
        """
        columns = columns_of(level.dims)
        self.thickness = (thickness_of(volume, finer), thickness_of(volume, level))
        self._levels = (finer, level)
        self._factors = factors_of(finer, level)
        self._coded = [_coded(one, of_one) for one, of_one in zip(columns, rows, strict=True)]
        self._ends = [one.ends for one in columns]
        self._steps = [step / level.reference_spacing for step in level.spacing]
        self._each = [one.every / one.number for one in columns]  # that a column or bundle stands for

    def sides(self, eye: Vector | None) -> list[Side]:
        """From where to look if `eye` is towards the viewer, along i, j, k; with None along all axes alike.

        A ray is made of an axis, a face's diagonal and a cube's, so that it crosses as many voxels on each axis.
        """
        if eye is None:
            return [self._side(axis, Slant(), False, 1.0 / step) for axis, step in enumerate(self._steps)]
        crossed = [abs(along) / step for along, step in zip(eye, self._steps, strict=True)]
        most_first = sorted(range(3), key=lambda axis: -crossed[axis])
        sides, direction = [], [0, 0, 0]
        for axis, less in zip(most_first, [*most_first[1:], None], strict=True):
            direction[axis] = 1 if eye[axis] > 0.0 else -1
            part = crossed[axis] - (0.0 if less is None else crossed[less])
            if part > 0.0:
                sides.append(self._towards(direction, _slant(eye, direction), part))
        return sides

    def _towards(self, direction: Sequence[int], slant: Slant, part: float) -> Side:
        i, j, k = direction
        from_high = (i, j, k) in DIRECTIONS
        number = DIRECTIONS.index((i, j, k) if from_high else (-i, -j, -k))
        return self._side(number, slant, from_high, part)

    def _side(self, number: int, slant: Slant, from_high: bool, part: float) -> Side:
        return Side(number, slant, from_high, part * self._each[number])

    def lengths(self, number: int) -> tuple[float, float]:
        """What a column runs in a layer of the finer level and in a voxel of the level, in their reference spacings."""
        direction, (finer, level) = DIRECTIONS[number], self._levels
        moved = matrices.length(matrices.applied(level.index_to_physical, direction)) / sum(map(abs, direction))
        return moved / self._layers(number) / finer.reference_spacing, moved / level.reference_spacing

    def _layers(self, number: int) -> int:
        """Of the finer level, that are seen one behind the other in a voxel: along diagonals footprints mix them."""
        return self._factors[number] if DIRECTIONS[number] in AXES else 1

    def seen(self, number: int, slant: Slant, finer: Looks, coarser: Looks) -> tuple[Seen, Seen]:
        """In one of DIRECTIONS, from the lower and from the upper end."""
        rows = np.frombuffer(zstandard.decompress(self._coded[number]), np.uint32).reshape(-1, ROW)
        low, high = (self._seen(number, slant, rows, from_high, finer, coarser) for from_high in (False, True))
        return low, high

    def _seen(self, number: int, slant: Slant, rows: Rows, from_high: bool, finer: Looks, coarser: Looks) -> Seen:
        of_levels = _kernels.seen_in_columns(
            rows.data,
            self._ends[number].data,
            number if DIRECTIONS[number] in AXES else NO_AXIS,
            from_high,
            slant,
            self._factors,
            finer.data,
            coarser.data,
        )
        (finer_emitted, *of_finer), (coarser_emitted, *of_coarser) = of_levels
        reflected = (Reflected(*map(np.asarray, of_finer)), Reflected(*map(np.asarray, of_coarser)))
        return Seen((finer_emitted, coarser_emitted), reflected)


def _coded(columns: Columns, rows: Rows) -> bytes:
    if rows.shape != (columns.rows, ROW) or rows.dtype != np.uint32:
        raise ValueError(f"{columns.rows} voxels in columns have no rows of shape {rows.shape}")
    coded: bytes = zstandard.ZstdCompressor(level=QUICK).compress(rows.data)
    return coded


def _slant(eye: Vector, direction: Sequence[int]) -> Slant:
    if sum(map(abs, direction)) > 1:
        return Slant()
    first, second = (towards >= LEVEL for towards, along in zip(eye, direction, strict=True) if not along)
    return Slant(first, second)
