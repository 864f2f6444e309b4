"""What the voxels of a coarser level stand for, and what that makes of tables, in plain float64 torch."""

import torch
from torch import Tensor

from reference.level_means import corner_of, corners, sides_of
from volsplat.protocol.rules.packet_layout import NO_DATA_BIN, NO_DATA_BIT, strength_bin

_STRENGTHS = torch.tensor([strength_bin(strength) for strength in range(256)])
_BIN_OF_ENTRY = (_STRENGTHS[:, None] * 256 + torch.arange(256)).flatten()  # of density | strength << 8


BINS = NO_DATA_BIN + 1


def bins(packets: Tensor) -> Tensor:
    """Of packets, int64 of any shape: density | strength's bin << 8, or that of no data."""
    return torch.where(packets >> NO_DATA_BIT == 0, _BIN_OF_ENTRY[packets & 65535], NO_DATA_BIN)


def mixture(finer: Tensor, coarser: Tensor) -> Tensor:
    """How many voxels with data of a level (k, j, i) have each bin and are the mean of a voxel of each bin: rows of
    that bin, this one, and the number."""
    pairs = []
    sides = sides_of(finer.shape, coarser.shape)
    for at in corners(sides):
        corner = corner_of(finer, sides, at)
        mean = coarser[tuple(slice(0, n) for n in corner.shape)]
        pairs.append((bins(mean) * BINS + bins(corner)).flatten())
    both, counts = torch.unique(torch.cat(pairs), return_counts=True)
    rows = torch.stack((both // BINS, both % BINS, counts), dim=1)
    return rows[rows[:, 0] != NO_DATA_BIN]


def level_table(table: Tensor, mixtures: list[Tensor]) -> Tensor:
    """Of a table (65536, channels) of the volume's own voxels that of the level that these lead to, level by level."""
    sums = torch.zeros((NO_DATA_BIN + 1, table.shape[1]), dtype=torch.float64)
    entries = torch.bincount(_BIN_OF_ENTRY, minlength=NO_DATA_BIN + 1).clamp(min=1)
    means = sums.index_add(0, _BIN_OF_ENTRY, table) / entries[:, None]
    for rows in mixtures:
        coarse, fine, counts = rows.unbind(1)
        total = torch.bincount(coarse, counts.double(), NO_DATA_BIN + 1).clamp(min=1)
        means = sums.index_add(0, coarse, counts[:, None] * means[fine]) / total[:, None]
    return means[_BIN_OF_ENTRY]
