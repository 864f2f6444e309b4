"""What the voxels of a level stand for, and the rows of its columns, while the level before is packed: a file for each
shard of that."""

import os
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from volsplat.mapshade_server._kernels import MixtureEntries, mixture_of
from volsplat.mapshade_server.held.level_columns import PLACED_ROW, ROW, PlacedRows, Rows, columns_of
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


class ShardFiles:
    """Arrays of each shard of a level, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @contextmanager
    def _written(self, shard: Box) -> Iterator[BinaryIO]:
        """The file of a shard, which is laid down for good."""
        self._folder.mkdir(exist_ok=True)
        with (self._folder / "-".join(map(str, shard.low))).open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())

    def _files(self) -> Iterator[Path]:
        """That of one shard after the other, but for those of nothing."""
        return (path for path in self._folder.iterdir() if path.stat().st_size)


class MixtureFiles(ShardFiles):
    """What is the mean of each shard of the level before."""

    def write(self, shard: Box, mixture: Mixture) -> None:
        with self._written(shard) as file:
            for part in mixture:
                np.save(file, part)

    def joined(self) -> Mixture:
        """Of all shards together, whose order does not matter."""
        total = NOTHING.entries()
        for path in self._files():
            with path.open("rb") as file:
                keys, counts, left_open = (np.load(file) for _ in NOTHING)
            total.add(Mixture(keys, counts, int(left_open)).entries())
        return Mixture.of_entries(total)


class ColumnFiles(ShardFiles):
    """The rows of columns of the means of each shard of the level before."""

    def write(self, shard: Box, rows: PlacedRows) -> None:
        with self._written(shard) as file:
            file.write(rows.data)

    def joined(self, dims: Index) -> Iterator[Rows]:
        """All of a level of so many voxels, those of one direction at a time."""
        for columns in columns_of(dims):
            rows = np.empty((columns.rows, ROW), np.uint32)
            for path in self._files():  # mapped anew: what was looked at of a map counts as memory
                of_shard = np.memmap(path, np.uint32, "r").reshape(-1, PLACED_ROW)
                begin, end = (bisect_left(of_shard[:, 0], place) for place in (columns.begin, columns.end))
                rows[of_shard[begin:end, 0] - columns.begin] = of_shard[begin:end, 1:]
            yield rows
