"""Voxels as they are drawn, in numbers: where they are, their opacity and colour. What leaves for other programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.answers.voxel_fields import VoxelFields
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT


class Voxels(NamedTuple):
    """Some visible ones of a sheet."""

    indices: NDArray[np.int64]  # (n, 3) i, j, k
    opacity: NDArray[np.float32]  # (n,)
    emitted: NDArray[np.float32]  # (n, 3), 0 to 1, and so is the next, before light
    reflected: NDArray[np.float32]
    directions: NDArray[np.int64]  # (n,) codes of the gradient's direction


@dataclass(frozen=True)
class VoxelSheets:
    """Every `every`th voxel on each axis of some sub-cubes, within the bounds of a plan.

    The sub-cubes, `level` and all indices are of the level that the plan of `fields` draws.
    """

    sub_cubes: Sequence[SubCube]
    fields: VoxelFields
    level: Geometry
    every: int

    @property
    def sheets(self) -> int:
        """How many `visible` and `counts` go through."""
        return sum(len(self._indices(cube, 2)) for cube in self.sub_cubes)

    def counts(self, least: float) -> Iterator[int]:
        """How many voxels of each sheet have at least this opacity, above 0."""
        for cube, k in self._all_sheets():
            index, packets = self._sheet(cube, k)
            yield int(np.count_nonzero(self._opacity(index, packets) >= least))

    def visible(self, least: float) -> Iterator[Voxels]:
        """Those voxels, sheet by sheet."""
        for cube, k in self._all_sheets():
            index, packets = self._sheet(cube, k)
            opacity = self._opacity(index, packets)
            seen = opacity >= least
            index, packets = index[seen], packets[seen]
            emitted, reflected = self.fields.colours(index, packets)
            directions = (packets >> DIRECTION_SHIFT & 0x7FFF).astype(np.int64)
            yield Voxels(index, opacity[seen], emitted, reflected, directions)

    def densities(self) -> Iterator[tuple[Index, NDArray[np.uint8], NDArray[np.bool_]]]:
        """Of each sheet within a sub-cube: where it begins, counted in every `every`th; density bytes and where there
        are data, both (j, i)."""
        first = [self._wanted(axis).start for axis in range(3)]
        for cube, k in self._all_sheets():
            i, j = self._indices(cube, 0), self._indices(cube, 1)
            packets = self._packets(cube, i, j, k)
            begin = [(at - low) // self.every for at, low in zip((i[0], j[0], k), first, strict=True)]
            there = packets >> np.uint32(NO_DATA_BIT) == 0
            yield (begin[0], begin[1], begin[2]), (packets & 255).astype(np.uint8), there

    @property
    def dims(self) -> Index:
        """How many voxels there are in all along i, j, k."""
        i, j, k = (len(self._wanted(axis)) for axis in range(3))
        return (i, j, k)

    @property
    def first(self) -> Index:
        """The first of them."""
        i, j, k = (self._wanted(axis).start for axis in range(3))
        return (i, j, k)

    def _wanted(self, axis: int) -> range:
        bounds = self.fields.drawing.plan.bounds
        low, high = bounds.low[axis], bounds.high[axis]
        start = low + min(self.every, high - low) // 2
        return range(start, high, self.every)

    def _indices(self, cube: SubCube, axis: int) -> range:
        """The wanted ones that the sub-cube has."""
        wanted, low, high = self._wanted(axis), cube.box.low[axis], cube.box.high[axis]
        first = max(-(-(low - wanted.start) // self.every), 0)
        return range(wanted.start + first * self.every, min(high, wanted.stop), self.every)

    def _all_sheets(self) -> Iterator[tuple[SubCube, int]]:
        for cube in self.sub_cubes:
            if self._indices(cube, 0) and self._indices(cube, 1):
                for k in self._indices(cube, 2):
                    yield cube, k

    def _packets(self, cube: SubCube, i: range, j: range, k: int) -> NDArray[np.uint32]:
        i0, j0, k0 = cube.box.low
        held = np.asarray(memoryview(cube.packets))[k - k0]
        taken: NDArray[np.uint32] = held[
            j.start - j0 : j.stop - j0 : self.every, i.start - i0 : i.stop - i0 : self.every
        ]
        return taken

    def _sheet(self, cube: SubCube, k: int) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
        """Indices (n, 3) and packets (n,) of the voxels with data."""
        i, j = self._indices(cube, 0), self._indices(cube, 1)
        packets = self._packets(cube, i, j, k)
        rows, samples = np.nonzero(packets >> np.uint32(NO_DATA_BIT) == 0)
        places = (i.start + samples * self.every, j.start + rows * self.every, np.full(len(rows), k))
        return np.stack(places, axis=-1), packets[rows, samples]

    def _opacity(self, index: NDArray[np.int64], packets: NDArray[np.uint32]) -> NDArray[np.float32]:
        thickness = self.every * self.level.reference_spacing / self.fields.drawing.geometry.reference_spacing
        return self.fields.opacity(index, packets, thickness)
