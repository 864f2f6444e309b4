"""What the voxels of a coarser level stand for, and what that makes of the tables that they are classified by.

A mean tells little of what it is the mean of. So a prepared volume tells of all voxels of a level that have the same
density and nearly the same strength how many voxels of the level before they are the means of, by the density and
strength of those; and what they look like is the mean of what those look like.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.level_columns import LevelColumns

Keys = NDArray[np.uint32]  # a bin of the level << BIN_BITS | a bin of the finer one, see packet_layout
Counts = NDArray[np.uint64]
Table = NDArray[np.float64]  # (65536, channels), at density | strength << 8


class LevelMixture:
    """That of one level; `finer` is the one of the level before, and None where that is the volume itself."""

    def __init__(
        self, finer: LevelMixture | None, keys: Keys, counts: Counts, columns: LevelColumns | None = None
    ) -> None:
        """Raises ValueError for entries that are none. Without columns it is as bright as it is."""
        self.finer = finer
        self.columns = columns
        self._entries = _kernels.MixtureEntries(keys.data, counts.data, 0)

    def means(self, table: Table) -> Table:
        """Of a table of the volume's own voxels that of this level's, whose strengths are told apart by bins."""
        return np.asarray(_kernels.unbinned(self._in_bins(table)))

    def _in_bins(self, table: Table) -> _kernels.Array:
        finer = _kernels.binned(table.data) if self.finer is None else self.finer._in_bins(table)
        return self._entries.mixed(finer)
