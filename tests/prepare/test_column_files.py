"""What is kept of columns while a level is packed, shard by shard."""

from pathlib import Path

import numpy as np

from volsplat.mapshade_server.held.level_columns import PLACED_ROW, columns_of
from volsplat.mapshade_server.prepare.mixture_files import ColumnFiles
from volsplat.protocol.description.volume import Box, Index


def test_rows_of_shards_are_joined_direction_by_direction_whatever_shard_they_are_of(tmp_path: Path) -> None:
    dims: Index = (11, 9, 10)
    columns = columns_of(dims)
    rows = np.random.default_rng(1).integers(0, 1 << 32, (columns[-1].end, PLACED_ROW), np.uint32)
    rows[:, 0] = np.arange(len(rows))
    of_shard = np.random.default_rng(2).integers(0, 3, len(rows))  # and none of the last
    files = ColumnFiles(tmp_path / "columns")
    for n in range(4):
        files.write(Box((0, 0, n), (11, 9, n + 1)), rows[of_shard == n])
    for one, joined in zip(columns, files.joined(dims), strict=True):
        assert (joined == rows[one.begin : one.end, 1:]).all()
