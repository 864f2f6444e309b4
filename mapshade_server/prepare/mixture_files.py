"""What the voxels of a level stand for, counted while the level before is packed: a file for each of its shards."""

import os
from pathlib import Path

import numpy as np

from volsplat.mapshade_server._kernels import MixtureEntries
from volsplat.protocol.description.volume import Box


class MixtureFiles:
    """Those of one level, in a folder of their own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, shard: Box, mixture: MixtureEntries) -> None:
        """Lays down for good what is the mean of a shard of the level before."""
        self._folder.mkdir(exist_ok=True)
        with (self._folder / "-".join(map(str, shard.low))).open("wb") as file:
            np.savez(file, keys=mixture.keys, counts=mixture.counts, left_open=mixture.left_open)
            file.flush()
            os.fsync(file.fileno())

    def joined(self) -> MixtureEntries:
        """Of all shards together, whose order does not matter."""
        total = MixtureEntries(np.empty(0, np.uint32).data, np.empty(0, np.uint64).data, 0)
        for path in self._folder.iterdir():
            with np.load(path) as of_shard:
                keys, counts = of_shard["keys"], of_shard["counts"]
                total.add(MixtureEntries(keys.data, counts.data, int(of_shard["left_open"])))
        return total
