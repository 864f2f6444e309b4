"""Compressed voxels that are read from the first sheet to the last are unpacked once; what is made of voxels is made
of as many sheets at a time as fit.
"""

import gzip
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.mapshade_server.readers.reading import stored_voxels, unpacked_stream
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.unpacked_stream import Packing, UnpackedStream
from volsplat.mapshade_server.readers.reading.volume_reader import BYTES_BESIDE, Voxels, by_sheets, voxel_room
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

VALUES = np.arange(40 * 30 * 20, dtype=np.uint16).reshape(20, 30, 40)


@pytest.fixture(scope="module")
def zipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("zipped") / "voxels.gz"
    path.write_bytes(gzip.compress(b"skip" + VALUES.tobytes()))
    return path


def voxels_in(path: Path) -> StoredVoxels:
    return StoredVoxels(path, (40, 30, 20), VALUES.dtype, (Piece(path, 20, 0, Packing.DEFLATE, 4),))


@given(ranges=st.lists(st.tuples(st.integers(0, 19), st.integers(1, 20)).map(sorted), min_size=1, max_size=6))
def test_boxes_in_any_order_give_their_voxels(ranges: list[list[int]], zipped: Path) -> None:
    voxels = voxels_in(zipped)
    for low, high in ranges:
        high = max(high, low + 1)
        assert (voxels.read(Box((3, 4, low), (33, 24, high))) == VALUES[low:high, 4:24, 3:33]).all()


def test_sheets_after_each_other_unpack_the_file_once(zipped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacked_stream, "PACKED_CHUNK_BYTES", 512)
    unpacked = 0

    class Counting(UnpackedStream):
        def fill(self, into: memoryview) -> None:
            nonlocal unpacked
            unpacked += len(into)
            super().fill(into)

        def drop(self, count: int) -> None:
            nonlocal unpacked
            unpacked += count
            super().drop(count)

    monkeypatch.setattr(stored_voxels, "UnpackedStream", Counting)
    voxels = voxels_in(zipped)
    sheets = [voxels.read(Box((0, 0, k), (40, 30, k + 5))) for k in range(0, 20, 5)]
    assert (np.concatenate(sheets) == VALUES).all()
    assert unpacked == VALUES.nbytes + 4


@pytest.mark.parametrize("count", [1, 511, 512, 5000])
@pytest.mark.parametrize("compress", [gzip.compress, zlib.compress])
def test_zeros_after_a_stream_are_padding(
    count: int, compress: Callable[[bytes], bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on tapes, and as gunzip takes them; between two streams, too."""
    monkeypatch.setattr(unpacked_stream, "PACKED_CHUNK_BYTES", 512)
    path, raw = tmp_path / "voxels.gz", b"skip" + VALUES.tobytes()
    path.write_bytes(b"".join(compress(part) + bytes(count) for part in (raw[:9999], raw[9999:])))
    voxels = voxels_in(path)
    voxels.check_files()
    assert (voxels.read(Box((0, 0, 0), (40, 30, 20))) == VALUES).all()
    path.write_bytes(path.read_bytes() + b"no stream")
    with pytest.raises(zlib.error):
        UnpackedStream(path, 0, Packing.DEFLATE).drain(1 << 20)


@pytest.mark.parametrize("numbers", [1, 3, 1024])
@pytest.mark.parametrize("box", [Box((1, 2, 3), (5, 6, 70_001)), Box((0, 0, 5), (300, 300, 12))])
def test_as_many_sheets_as_fit_are_made_at_a_time_and_at_least_one(box: Box, numbers: int) -> None:
    made: list[Box] = []

    def numbered(part: Box) -> Voxels:
        made.append(part)
        return np.broadcast_to(np.arange(part.low[2], part.high[2])[:, None, None], part.size[::-1])

    voxels = by_sheets("voxels", "float32", numbered, numbers)(box)
    assert (voxels == np.arange(box.low[2], box.high[2])[:, None, None]).all()
    sheet_bytes = box.size[0] * box.size[1] * numbers * 8
    assert all(part.size[2] == 1 or part.size[2] * sheet_bytes <= BYTES_BESIDE for part in made)
    assert all((part.size[2] + 1) * sheet_bytes > BYTES_BESIDE for part in made[:-1])


def test_a_box_larger_than_the_memory_names_a_cure_that_there_is() -> None:
    with pytest.raises(BadInput, match=r"big\.raw: .* GiB of voxels do not fit .*volsplat prepare"):
        voxel_room(Box((0, 0, 0), (1 << 20, 1 << 20, 1 << 10)), "float64", "big.raw")
