"""What the voxels of a level stand for, counted while the level before is packed: a file for each of its shards."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.level_mixture import Counts, Keys
from volsplat.mapshade_server.held.packet_store import Packets
from volsplat.protocol.description.volume import Box


class Mixture(NamedTuple):
    """As in level_mixture, of a part of a level or of all of it."""

    keys: Keys
    counts: Counts

    @classmethod
    def of_counts(cls, counts: _kernels.MixtureCounts) -> "Mixture":
        found, numbers = counts.entries()
        return cls(np.asarray(found).astype(np.uint32), np.asarray(numbers).astype(np.uint64))

    @classmethod
    def of_voxels(cls, finer: Packets, coarser: Packets) -> "Mixture":
        """Of a box, and the voxels of the next level that are the means of it."""
        counts = _kernels.MixtureCounts()
        counts.add_voxels(finer.data, coarser.data)
        return cls.of_counts(counts)


class MixtureFiles:
    """Those of one level, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, shard: Box, mixture: Mixture) -> None:
        """Lays down for good what is the mean of a shard of the level before."""
        self._folder.mkdir(exist_ok=True)
        with (self._folder / "-".join(map(str, shard.low))).open("wb") as file:
            for array in mixture:
                np.save(file, array)
            file.flush()
            os.fsync(file.fileno())

    def joined(self) -> Mixture:
        """Of all shards together."""
        total = _kernels.MixtureCounts()
        for path in self._folder.iterdir():
            with path.open("rb") as file:
                total.add(np.load(file).data, np.load(file).data)
        return Mixture.of_counts(total)
