"""How opaque the blocks are that light passes (light_blocks): summed over the voxels that are held here."""

from collections.abc import Sequence
from decimal import Decimal, localcontext
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.answers.voxel_fields import VoxelFields
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.light_blocks import (
    LEAST_THROUGH,
    SUM_UNIT,
    box_drawn,
    light_block_dims,
    light_block_size,
)
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT, OPACITY_CODES, opacity_of_code

Depths = NDArray[np.uint64]


def summed_depths(sub_cubes: Sequence[SubCube], drawing: Drawing) -> Depths:
    """Of each block of the level, shaped (k, j, i), the sum over its voxels that are drawn and held here."""
    fields, dims = VoxelFields(drawing), drawing.dims
    total = np.zeros(light_block_dims(dims)[::-1], np.uint64)
    size, drawn = light_block_size(dims), box_drawn(drawing.plan)
    for cube in sub_cubes:
        if (box := cube.box.common(drawn)) is not None:
            for sheets in box.layers(2, size[2]):
                total[sheets.low[2] // size[2]] += _summed(cube, fields, sheets, size, total.shape[1:])
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
