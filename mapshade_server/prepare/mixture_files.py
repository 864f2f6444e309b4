"""What the voxels of a level stand for, counted while the level before is packed, and columns of them: a file for each
of its shards."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from volsplat.mapshade_server._kernels import MixtureEntries, mixture_of
from volsplat.mapshade_server.held.level_columns import ROW, Places, Rows, columns_of
from volsplat.mapshade_server.held.level_mixture import Counts, Keys
from volsplat.mapshade_server.held.packet_store import Packets
from volsplat.protocol.description.volume import Box, Index


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


class ColumnRows(NamedTuple):
    """As in level_columns, of a part of a level."""

    places: Places  # among all rows
    rows: Rows


class ShardFiles:
    """Arrays of each shard of a level, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, shard: Box, arrays: Sequence[Any]) -> None:
        """Lays them down for good."""
        self._folder.mkdir(exist_ok=True)
        with (self._folder / "-".join(map(str, shard.low))).open("wb") as file:
            for part in arrays:
                np.save(file, part)
            file.flush()
            os.fsync(file.fileno())

    def _read(self, count: int) -> Iterator[list[Any]]:
        """The arrays of one shard after the other."""
        for path in self._folder.iterdir():
            with path.open("rb") as file:
                yield [np.load(file) for _ in range(count)]


class MixtureFiles(ShardFiles):
    """What is the mean of each shard of the level before."""

    def joined(self) -> Mixture:
        """Of all shards together, whose order does not matter."""
        total = NOTHING.entries()
        for keys, counts, left_open in self._read(len(NOTHING)):
            total.add(Mixture(keys, counts, int(left_open)).entries())
        return Mixture.of_entries(total)


class ColumnFiles(ShardFiles):
    """The rows of columns of the means of each shard of the level before."""

    def joined(self, dims: Index) -> Rows:
        """All of a level of so many voxels."""
        rows = np.empty((columns_of(dims)[-1].end, ROW), np.uint32)
        for places, of_shard in self._read(2):
            rows[places] = of_shard
        return rows
