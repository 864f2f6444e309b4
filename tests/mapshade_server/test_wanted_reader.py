"""Voxels that are read for as long as somebody wants them."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.files.counted_bytes import bytes_read
from volsplat.mapshade_server.held.wanted_reader import GivenUp, WantedReader
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.protocol.description.volume import Box

DIMS = (8, 6, 40)
CHUNKED = 7  # sheets


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> OpenedVolume:
    path = tmp_path_factory.mktemp("chunked") / "v.h5"
    values = np.arange(np.prod(DIMS), dtype=np.uint16).reshape(DIMS[::-1])
    with h5py.File(path, "w") as file:
        file.create_dataset("v", data=values, chunks=(CHUNKED, 6, 8))
    return open_volume(str(path))


@given(ends=st.lists(st.integers(0, DIMS[2]), min_size=2, max_size=2, unique=True), part_bytes=st.integers(1, 9000))
def test_parts_make_up_the_box(volume: OpenedVolume, ends: list[int], part_bytes: int) -> None:
    low, high = sorted(ends)
    box = Box((1, 0, low), (7, 6, high))
    reader = WantedReader(volume, lambda: False, part_bytes)
    np.testing.assert_array_equal(reader.read(box), volume.read(box), strict=True)


def test_each_chunk_belongs_to_one_part(volume: OpenedVolume) -> None:
    asked: list[tuple[int, int]] = []

    class Noting(WantedReader):
        def read(self, box: Box) -> np.ndarray:
            asked.append((box.low[2], box.high[2]))
            return super().read(box)

    noting = Noting(volume, lambda: False)
    WantedReader(noting, lambda: False, part_bytes=1).read(volume.description.geometry.box)
    assert [low for low, _ in asked] == list(range(0, DIMS[2], CHUNKED))


def test_who_is_given_up_reads_no_more(tmp_path: Path) -> None:
    path = tmp_path / "v_64x64x64_uint16.raw"
    np.zeros(64**3, np.uint16).tofile(path)
    opened = open_volume(str(path))
    box, sheet = opened.description.geometry.box, 64 * 64 * 2
    looks: list[int] = []

    def given_up() -> bool:
        looks.append(1)
        return len(looks) > 3

    before = bytes_read()
    with pytest.raises(GivenUp):
        WantedReader(opened, given_up, part_bytes=sheet).read(box)
    assert 3 * sheet <= bytes_read() - before < 8 * sheet
    assert WantedReader(opened, lambda: False).description == opened.description
