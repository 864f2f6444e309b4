"""Voxels as they are drawn, in numbers: where they are, their opacity and colour. What leaves for other programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import shading_tables
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.description.scene import Field
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.index_rules import DirectionCode, Quantisation
from volsplat.protocol.rules.levels import dims_at_level
from volsplat.protocol.rules.light_blocks import (
    LEAST_THROUGH,
    SUM_UNIT,
    box_drawn,
    light_block_dims,
    light_block_size,
)
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, NO_DATA_BIT, OPACITY_CODES, opacity_of_code
from volsplat.protocol.rules.shading_rule import Lighting, ShadingRule

GRADIENTS = (Field.GRADIENT_I, Field.GRADIENT_J, Field.GRADIENT_K)
SCREEN = (Field.SCREEN_X, Field.SCREEN_Y, Field.SCREEN_Z)
GRID = (Field.GRID_I, Field.GRID_J, Field.GRID_K)

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]  # (n, 3) i, j, k, of the level that the plan draws
Packets = NDArray[np.uint32]  # (n,)
Colours = NDArray[np.float32]  # (n, 3), 0 to 1, before light


@dataclass(frozen=True)
class VoxelFields:
    """What a frame by these rules makes of many voxels at once; `geometry` is the volume's."""

    geometry: Geometry
    quantisation: Quantisation
    shading: ShadingRule
    plan: FramePlan

    @property
    def directions(self) -> DirectionCode:
        return self.quantisation.directions_at(self.plan.factors)

    @property
    def uses_index(self) -> bool:
        """Whether opacity depends on where a voxel lies."""
        return not shading_tables.opacity_rule(self.shading).by_packet

    def opacity(self, index: Indices, packets: Packets, thickness: float) -> NDArray[np.float32]:
        """Of cells so thick, in reference spacings of the volume."""
        opacities: NDArray[np.float32] = OPACITIES[self.opacity_codes(index, packets, thickness)]
        return opacities

    def opacity_codes(self, index: Indices, packets: Packets, thickness: float) -> NDArray[np.uint16]:
        """Likewise. Where the index is not used it may be left empty."""
        rule = shading_tables.opacity_rule(self.shading)
        codes = np.asarray(memoryview(shading_tables.opacity_codes(rule, thickness)))
        if rule.by_packet:
            by_packet: NDArray[np.uint16] = codes[packets & np.uint32(0xFFFF)]
            return by_packet
        low, high = (
            self.bytes_of(field, index, packets).astype(np.int64) for field in shading_tables.opacity_fields(rule)
        )
        by_fields: NDArray[np.uint16] = codes[low | high << 8]
        return by_fields

    def colours(self, index: Indices, packets: Packets) -> tuple[Colours, Colours]:
        """Emitted and reflected."""
        tables, cross_bar = shading_tables.frame_colours(self.shading), self.shading.cross_bar
        emitted, reflected = (
            np.asarray(table, dtype=np.float32)[self._entries(field, index, packets, tables.of_plane), :3]
            for table, field in ((tables.emit, cross_bar.emit), (tables.refl, cross_bar.refl))
        )
        return emitted, reflected

    def _entries(self, field: Field, index: Indices, packets: Packets, of_plane: bool) -> Packets | Bytes:
        return packets & np.uint32(0xFFFF) if of_plane else self.bytes_of(field, index, packets)

    def bytes_of(self, field: Field, index: Indices, packets: Packets) -> Bytes:
        if field == Field.DENSITY:
            return (packets & 255).astype(np.uint8)
        if field == Field.STRENGTH:
            return (packets >> 8 & 255).astype(np.uint8)
        if field in GRADIENTS:
            directions = np.asarray(shading_tables.gradient_bytes(self.directions, self.geometry.index_to_physical))
            of_codes: Bytes = directions[GRADIENTS.index(field), packets >> DIRECTION_SHIFT & 0x7FFF]
            return of_codes
        if field in SCREEN:
            dda = self.plan.screen_index[SCREEN.index(field)]
            place = dda.origin + 2 * index @ np.array(dda.half_steps, dtype=np.int64)
            of_screen: Bytes = np.clip(place >> FRACTION_BITS, 0, 255).astype(np.uint8)
            return of_screen
        axis = GRID.index(field)
        grid = np.frombuffer(shading_tables.grid_bytes(self.geometry.dims[axis], self.plan.factors[axis]), np.uint8)
        of_axis: Bytes = grid[index[:, axis]]
        return of_axis


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

    def light(self, lighting: Lighting) -> NDArray[np.float32]:
        """What multiplies the reflected colour, by the direction's code."""
        codes = self.fields.directions
        return np.asarray(shading_tables.light_of_directions(lighting, codes), dtype=np.float32)

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
        low, high = self.fields.plan.bounds.low[axis], self.fields.plan.bounds.high[axis]
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
        thickness = self.every * self.level.reference_spacing / self.fields.geometry.reference_spacing
        return self.fields.opacity(index, packets, thickness)


OPACITIES = np.array([opacity_of_code(code) for code in range(OPACITY_CODES)], dtype=np.float32)

# How opaque the blocks are that light passes (see light_blocks).

Depths = NDArray[np.uint64]


def depths_summed(request: messages.SumDepths, sub_cubes: Sequence[SubCube]) -> tuple[messages.DepthsSummed, bytes]:
    """The answer to a request, with its payload."""
    fields = VoxelFields(request.geometry, request.quantisation, request.shading, request.plan)
    dims = dims_at_level(request.geometry.dims, request.plan.factors)
    sums = summed_depths(sub_cubes, fields, dims)
    return messages.DepthsSummed(request.frame, request.assignment, light_block_dims(dims)), sums.astype(
        "<u8"
    ).tobytes()


def summed_depths(sub_cubes: Sequence[SubCube], fields: VoxelFields, dims: Index) -> Depths:
    """Of each block of a level of `dims` voxels (k, j, i) the sum over its voxels that are drawn and held here."""
    total = np.zeros(light_block_dims(dims)[::-1], np.uint64)
    size, drawn = light_block_size(dims), box_drawn(fields.plan)
    for cube in sub_cubes:
        rest = cube.box.common(drawn)
        while rest is not None:
            row = rest.low[2] // size[2]
            end = (row + 1) * size[2]
            sheets, rest = rest.cut(2, end) if end < rest.high[2] else (rest, None)
            total[row] += _summed(cube, fields, sheets, size, total.shape[1:])
    return total


def _summed(cube: SubCube, fields: VoxelFields, box: Box, size: Index, shape: tuple[int, ...]) -> Depths:
    """Of one row of blocks along k."""
    (i0, j0, k0), (i1, j1, k1) = box
    added = np.zeros((j1 - j0, i1 - i0), np.uint64)
    held = np.asarray(memoryview(cube.packets))[box.slices(cube.box.low)]
    for k, packets in zip(range(k0, k1), held, strict=True):
        index = _indices(box, k) if fields.uses_index else np.zeros((0, 3), np.int64)
        codes = fields.opacity_codes(index, packets.reshape(-1), thickness=1.0).reshape(packets.shape)
        added += np.where(packets >> np.uint32(NO_DATA_BIT) == 0, _depths_of_codes()[codes], 0)
    (first_i, starts_i), (first_j, starts_j) = (
        _starts(low, high, of) for low, high, of in ((i0, i1, size[0]), (j0, j1, size[1]))
    )
    blocks = np.add.reduceat(np.add.reduceat(added, starts_i, axis=1), starts_j, axis=0)
    total = np.zeros(shape, np.uint64)
    total[first_j : first_j + blocks.shape[0], first_i : first_i + blocks.shape[1]] = blocks
    return total


def _starts(low: int, high: int, size: int) -> tuple[int, list[int]]:
    """The first block, and where each begins, from `low` on."""
    first = low // size
    return first, [max(block * size - low, 0) for block in range(first, (high - 1) // size + 1)]


def _indices(box: Box, k: int) -> NDArray[np.int64]:
    """(n, 3) of a sheet."""
    (i0, j0, _), (i1, j1, _) = box
    j, i = np.mgrid[j0:j1, i0:i1]
    return np.stack((i, j, np.full_like(i, k)), axis=-1).reshape(-1, 3).astype(np.int64)


@lru_cache(maxsize=1)
def _depths_of_codes() -> NDArray[np.uint64]:
    """Of one reference spacing. In decimal arithmetic, which is the same on every machine."""
    with localcontext() as context:
        context.prec = 20
        through = (Decimal(max(1 - opacity_of_code(code), LEAST_THROUGH)) for code in range(OPACITY_CODES))
        depths = [int((-each.ln() * SUM_UNIT).to_integral_value()) for each in through]
    return np.array(depths, np.uint64)
