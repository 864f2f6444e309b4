"""The least and greatest density in each block of a sub-cube's voxel packets: where something may be seen."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.rules.packet_layout import NO_DATA_BIT

BLOCK = 8  # voxels along each axis, which is about as far as a slab looks

Bytes = NDArray[np.uint8]


class BlockDensities(NamedTuple):
    """Of each block, (k, j, i); the least is above the greatest where no voxel has data."""

    least: Bytes
    greatest: Bytes


def block_densities(packets: NDArray[np.uint32]) -> BlockDensities:
    """Of packets (k, j, i), a sheet of blocks at a time."""
    sheets = [_of_sheet(packets[k : k + BLOCK]) for k in range(0, len(packets), BLOCK)]
    return BlockDensities(np.stack([least for least, _ in sheets]), np.stack([greatest for _, greatest in sheets]))


def _of_sheet(packets: NDArray[np.uint32]) -> tuple[Bytes, Bytes]:
    return extremes(packets.astype(np.uint8), -(packets >> NO_DATA_BIT).astype(np.uint8), BLOCK)


def extremes(values: Bytes, hidden: Bytes | None, block: int) -> tuple[Bytes, Bytes]:
    """The least and the greatest in a sheet of blocks (k, j, i), without what is hidden: that has all bits set."""
    least, greatest = (values, values) if hidden is None else (values | hidden, values & ~hidden)
    return by_block(np.minimum, least, block), by_block(np.maximum, greatest, block)


def by_block(reduce: np.ufunc, values: NDArray[Any], block: int) -> Bytes:
    """Over all k, and over blocks along j and i."""
    sheet = reduce.reduce(values, axis=0)
    for axis in (0, 1):
        sheet = reduce.reduceat(sheet, np.arange(0, sheet.shape[axis], block), axis=axis)
    return np.asarray(sheet, np.uint8)
