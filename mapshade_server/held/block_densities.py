"""The least and greatest density in each block of a sub-cube's voxel packets: where something may be seen."""

from typing import NamedTuple

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
    density, lacking = packets.astype(np.uint8), -(packets >> NO_DATA_BIT).astype(np.uint8)  # all bits, or none
    return _reduced(np.minimum, density | lacking), _reduced(np.maximum, density & ~lacking)


def _reduced(extreme: np.ufunc, sheet: Bytes) -> Bytes:
    lines = extreme.reduce(sheet, axis=0)
    for axis, length in enumerate(lines.shape):
        lines = extreme.reduceat(lines, np.arange(0, length, BLOCK), axis=axis)
    return np.asarray(lines, np.uint8)
