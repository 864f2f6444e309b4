"""What the voxels of a level stand for, counted while the level before is packed: a file for each of its shards."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server._kernels import MixtureEntries, mixture_of
from volsplat.mapshade_server.held.level_mixture import Counts, Keys
from volsplat.mapshade_server.held.packet_store import Packets
from volsplat.protocol.description.volume import Box


class Mixture(NamedTuple):
    """As in level_mixture, of a part of a level or of all of it."""

    keys: Keys
    counts: Counts
    left_open: int  # see MixtureEntries

    @classmethod
    def of_voxels(cls, finer: Packets, coarser: Packets) -> "Mixture":
        """Of a box, and the voxels of the next level that are the means of it."""
        return cls.of_entries(mixture_of(finer.data, coarser.data))

    @classmethod
    def of_entries(cls, entries: MixtureEntries) -> "Mixture":
        keys, counts = np.asarray(entries.keys).astype(np.uint32), np.asarray(entries.counts).astype(np.uint64)
        return cls(keys, counts, entries.left_open)

    def entries(self) -> MixtureEntries:
        return MixtureEntries(self.keys.data, self.counts.data, self.left_open)


NOTHING = Mixture(np.empty(0, np.uint32), np.empty(0, np.uint64), 0)


class MixtureFiles:
    """Those of one level, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, shard: Box, mixture: Mixture) -> None:
        """Lays down for good what is the mean of a shard of the level before."""
        self._folder.mkdir(exist_ok=True)
        with (self._folder / "-".join(map(str, shard.low))).open("wb") as file:
            for part in mixture:
                np.save(file, part)
            file.flush()
            os.fsync(file.fileno())

    def joined(self) -> Mixture:
        """Of all shards together, whose order does not matter."""
        total = NOTHING.entries()
        for path in self._folder.iterdir():
            with path.open("rb") as file:
                of_shard = Mixture(np.load(file), np.load(file), int(np.load(file)))
            total.add(of_shard.entries())
        return Mixture.of_entries(total)
