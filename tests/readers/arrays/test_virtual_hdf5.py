"""Virtual HDF5 datasets, which take their values from others."""

from pathlib import Path

import numpy as np
import pytest

from support.files.opened import read_whole

h5py = pytest.importorskip("h5py")


@pytest.mark.parametrize("settings", [{}, {"compression": "gzip"}], ids=["plain", "deflated"])
def test_a_small_crop_of_a_great_chunk_is_read(settings: dict[str, str], tmp_path: Path) -> None:
    shape = (65, 1024, 1024)  # more than 64 MiB
    with h5py.File(tmp_path / "whole.h5", "w") as file:
        made = file.create_dataset("v", shape, np.uint8, chunks=shape, **settings)
        made[30:34, 100:105, 200:206] = 7
    layout = h5py.VirtualLayout((4, 5, 6), np.uint8)
    layout[...] = h5py.VirtualSource("whole.h5", "v", shape)[30:34, 100:105, 200:206]
    with h5py.File(tmp_path / "crop.h5", "w", libver="latest") as file:
        file.create_virtual_dataset("v", layout)
    assert np.array_equal(read_whole(str(tmp_path / "crop.h5")), np.full((4, 5, 6), 7))
