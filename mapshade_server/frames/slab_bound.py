"""How many voxels of a sub-cube step G may need at most, by the least and greatest density of its blocks."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.block_densities import BLOCK, BlockDensities, Bytes
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.slab_kernels import LEAST_KNOWN
from volsplat.protocol.rules.slab_shape import SlabShape

DENSEST = TABLE_ENTRIES - 1


def most_needed(densities: BlockDensities, box: Box, drawing: Drawing, slabs: SlabShape) -> int:
    """Of the voxels of a box of the grid, as kernels/slabs/needed_voxels.h finds them."""
    least, greatest = (
        _widened(extreme, blocks, slabs.looks.reach)
        for extreme, blocks in zip((np.minimum, np.maximum), densities, strict=True)
    )
    needed = _widened(np.maximum, _showing(least, greatest, drawing, slabs), slabs.needs.reach)
    _mark_near_others(needed, box, drawing.dims, slabs)
    count: Any = needed
    for size, blocks in zip(box.size, needed.shape[::-1], strict=True):
        count = count @ np.minimum(BLOCK, size - BLOCK * np.arange(blocks))
    return int(count)


def _showing(least: Bytes, greatest: Bytes, drawing: Drawing, slabs: SlabShape) -> Bytes:
    """Where densities around enclose one that can be seen, or may be brought to it by weights below 0."""
    of_pair = _showing_pairs(drawing, slabs).ravel()
    return np.asarray(of_pair[least.astype(np.uint16) << 8 | greatest])


def _showing_pairs(drawing: Drawing, slabs: SlabShape) -> Bytes:
    """For each least density around, a row of all greatest ones."""
    seen = np.frombuffer(shading_tables.visibility(shading_tables.opacity_rule(drawing.shading)), np.uint8)
    up_to = np.concatenate(([0], np.cumsum(np.unpackbits(seen, count=TABLE_ENTRIES, bitorder="little"), dtype=int)))
    least, greatest = np.ogrid[:TABLE_ENTRIES, :TABLE_ENTRIES]
    between = np.maximum(greatest - least, 0).astype(float)
    more = np.ceil(np.minimum(between * slabs.overshoot / LEAST_KNOWN[slabs.kernel], DENSEST)).astype(int)
    first, last = np.maximum(least - more, 0), np.minimum(greatest + more, DENSEST)
    return np.asarray((least <= greatest) & (up_to[last + 1] > up_to[first]), np.uint8)


def _widened(extreme: Callable[..., Bytes], blocks: Bytes, reach: Index) -> Bytes:
    """The extremes of all that may lie so many voxels away from some of a block."""
    for axis, voxels in enumerate(reach[::-1]):
        found, before = blocks.copy(), (slice(None),) * axis  # memory is taken as it lies, whichever axis it is
        for shift in range(1, min(math.ceil(voxels / BLOCK) + 1, blocks.shape[axis])):
            later, earlier = (*before, slice(shift, None)), (*before, slice(None, -shift))
            extreme(found[later], blocks[earlier], out=found[later])
            extreme(found[earlier], blocks[later], out=found[earlier])
        blocks = found
    return blocks


def _mark_near_others(needed: Bytes, box: Box, dims: Index, slabs: SlabShape) -> None:
    """Blocks of which some may be needed for what lies in another box."""
    reaches = (looks + needs for looks, needs in zip(slabs.looks.reach, slabs.needs.reach, strict=True))
    for axis, (low, high, size, reach) in enumerate(zip(box.low, box.high, dims, reaches, strict=True)):
        lines = np.moveaxis(needed, 2 - axis, 0)
        if low > 0:
            lines[: math.ceil(reach / BLOCK)] = 1
        if high < size:
            lines[max(high - low - reach, 0) // BLOCK :] = 1
