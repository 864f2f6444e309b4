"""The least and greatest value in each block of a volume: all that a client knows of where something is.

Blocks divide the whole grid, at most MOST_BLOCKS on an axis, whatever its partition into sub-cubes; those of boxes join
into the volume's. Where no voxel of a block has a value, the least is above the greatest.
"""

import math
from array import array
from typing import NamedTuple

from volsplat.protocol.description.volume import Index

MOST_BLOCKS = 32  # on an axis
BLOCK_BYTES = 16  # of each: float64 least, float64 greatest


def block_size(dims: Index, most: int = MOST_BLOCKS) -> Index:
    """Voxels of a block along i, j, k; the last one on an axis may have fewer."""
    ni, nj, nk = dims
    return (-(-ni // most), -(-nj // most), -(-nk // most))


def block_dims(dims: Index, most: int = MOST_BLOCKS) -> Index:
    """Blocks along i, j, k of a grid of so many voxels."""
    (ni, nj, nk), (bi, bj, bk) = dims, block_size(dims, most)
    return (-(-ni // bi), -(-nj // bj), -(-nk // bk))


class BlockExtremes(NamedTuple):
    """Each list counts blocks shaped (k, j, i), i fastest."""

    least: list[float]
    greatest: list[float]

    @classmethod
    def of_bytes(cls, raw: bytes | memoryview) -> "BlockExtremes":
        """From float64 of all least values, then of all greatest ones."""
        values = array("d", bytes(raw))
        half = len(values) // 2
        return cls(list(values[:half]), list(values[half:]))

    @classmethod
    def nothing(cls, dims: Index) -> "BlockExtremes":
        """Of a grid of which no voxel has a value."""
        count = math.prod(block_dims(dims))
        return cls([math.inf] * count, [-math.inf] * count)

    def as_bytes(self) -> bytes:
        return array("d", [*self.least, *self.greatest]).tobytes()

    def joined(self, other: "BlockExtremes") -> "BlockExtremes":
        return BlockExtremes(
            [more if more < known else known for known, more in zip(self.least, other.least, strict=True)],
            [more if more > known else known for known, more in zip(self.greatest, other.greatest, strict=True)],
        )
