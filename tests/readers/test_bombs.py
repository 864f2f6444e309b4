"""Small files that would unpack to gigabytes: that ends at what the header promises, and is refused in one line."""

from __future__ import annotations

import bz2
import gzip
import lzma
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Literal

import h5py
import numcodecs
import numpy as np
import pytest
import tifffile
import zarr
from astropy.io import fits
from zarr.codecs import GzipCodec, ZstdCodec

from support.checkout import ROOT
from support.patience import PATIENCE
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.codestream_size import codestream_size
from volsplat.protocol.text.errors import BadInput

CHILD = ROOT / "tests/support/files/unpacking_child.py"
BOMB_BYTES = 256 << 20
MOST_MORE = 150  # MiB, of a process that reads them all; the libraries' own included
VALUES = (np.arange(16**3) % 251).astype(np.uint8).reshape(16, 16, 16)


@cache
def deflated(wbits: int) -> bytes:
    stream = zlib.compressobj(1, zlib.DEFLATED, wbits)
    zeros = bytes(1 << 22)
    return b"".join(stream.compress(zeros) for _ in range(BOMB_BYTES >> 22)) + stream.flush()


@cache
def zstandard() -> bytes:
    return bytes(numcodecs.Zstd(level=1).encode(np.zeros(BOMB_BYTES, np.uint8)))


@cache
def by_lzma() -> bytes:
    return lzma.compress(bytes(BOMB_BYTES), preset=0)


@cache
def by_bzip2() -> bytes:
    return bz2.compress(bytes(BOMB_BYTES), 9)


def zstandard_of_unknown_size() -> bytes:
    """A frame of runs of zeros that states no size."""
    block = 1 << 17
    runs = [(block << 3 | 2).to_bytes(3, "little") + b"\0"] * (BOMB_BYTES // block)
    return b"\x28\xb5\x2f\xfd\x00\x58" + b"".join(runs) + (1 << 3 | 3).to_bytes(3, "little") + b"\0"


def zarr_with(codec: Any, packed: Callable[[], bytes], version: Literal[2, 3] = 3) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / "v.zarr"
        array = zarr.create_array(
            path, shape=(16, 16, 16), chunks=(8, 8, 8), dtype="uint8", compressors=codec, zarr_format=version
        )
        array[...] = VALUES
        (path / ("c/0/0/0" if version == 3 else "0.0.0")).write_bytes(packed())
        return path

    return make


def hdf5(folder: Path, shuffle: bool, checked: bool) -> Path:
    path = folder / "v.h5"
    with h5py.File(path, "w") as file:
        made = file.create_dataset(
            "v", (16, 16, 16), np.uint8, chunks=(8, 8, 8), compression="gzip", shuffle=shuffle, fletcher32=checked
        )
        made[...] = VALUES
        made.id.write_direct_chunk((0, 0, 0), deflated(15) + bytes(4 * checked))
    return path


def hdf5_of_great_chunks(folder: Path) -> Path:
    path = folder / "v.h5"
    with h5py.File(path, "w") as file:
        made = file.create_dataset(
            "v", (16, 16, 16), np.uint8, chunks=(512, 1024, 1024), maxshape=(None,) * 3, compression="gzip"
        )
        made.id.write_direct_chunk((0, 0, 0), deflated(15))
    return path


def tiff(folder: Path, packed: bytes, compression: str) -> Path:
    """Pages of 16 x 16, the first one's only strip packed so."""
    path = folder / "v.tif"
    tifffile.imwrite(path, VALUES, compression=compression, photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        page: Any = file.pages[0]
        tags = [
            (page.tags[code].valueoffset, value) for code, value in ((273, path.stat().st_size), (279, len(packed)))
        ]
    with path.open("r+b") as file:
        for offset, value in tags:
            file.seek(offset)
            file.write(struct.pack("<I", value))
        file.seek(0, 2)
        file.write(packed)
    return path


def tiff_of_great_tiles(folder: Path) -> Path:
    path = folder / "v.tif"
    tifffile.imwrite(path, VALUES, tile=(16, 16), compression="zlib", photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        pages: list[Any] = list(file.pages)
        places = [page.tags[code].valueoffset for page in pages for code in (322, 323)]
    with path.open("r+b") as file:
        for offset in places:
            file.seek(offset)
            file.write(struct.pack("<H", 60000))
    return path


def fits_tile(folder: Path) -> Path:
    path = folder / "v.fits"
    fits.CompImageHDU(VALUES.astype(np.int16), compression_type="GZIP_1", tile_shape=(1, 16, 16)).writeto(path)
    packed = deflated(31)
    with fits.open(path, disable_image_compression=True) as hdus:
        start = hdus[1].fileinfo()["datLoc"]
        rows, heap = hdus[1].header["NAXIS2"] * hdus[1].header["NAXIS1"], hdus[1].header["PCOUNT"]
    with path.open("r+b") as file:  # the bomb behind the heap, which grows by it
        raw = bytearray(file.read())
        end = start + rows + heap
        raw[start : start + 8] = struct.pack(">ii", len(packed), heap)
        grown = bytes(raw[:end]) + packed
        grown += bytes(-len(grown) % 2880)
        at = grown.index(b"PCOUNT  =")
        grown = grown[:at] + f"PCOUNT  = {heap + len(packed):20d}".encode() + grown[at + 30 :]
        file.seek(0)
        file.write(grown)
    return path


def nrrd(folder: Path, encoding: str, packed: bytes) -> Path:
    path = folder / "v.nrrd"
    header = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: {encoding}\n\n"
    path.write_bytes(header.encode() + packed)
    return path


def text(folder: Path) -> Path:
    path = folder / "v.pdb.gz"
    line = b"ATOM      1  N   VAL A   1       6.204  16.869   4.854  1.00 49.05           N  \n"
    path.write_bytes(gzip.compress(line + bytes(100 << 20).replace(b"\0", b" "), 6))
    return path


def raw_gzip(folder: Path) -> Path:
    path = folder / "v_16x16x16_uint8.raw.gz"
    path.write_bytes(deflated(31))
    return path


BOMBS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "Zarr, zstd": (zarr_with(ZstdCodec(), zstandard), "unpacks to more than"),
    "Zarr, zstd of unknown size": (zarr_with(ZstdCodec(), zstandard_of_unknown_size), "unpacks to more than"),
    "Zarr, gzip": (zarr_with(GzipCodec(), lambda: deflated(31)), "unpacks to more than"),
    "Zarr 2, zstd": (zarr_with(numcodecs.Zstd(), zstandard, 2), "unpacks to more than"),
    "Zarr 2, zlib": (zarr_with(numcodecs.Zlib(), lambda: deflated(15), 2), "unpacks to more than"),
    "Zarr 2, bzip2": (zarr_with(numcodecs.BZ2(), by_bzip2, 2), "unpacks to more than"),
    "Zarr 2, LZMA": (
        zarr_with(numcodecs.LZMA(), by_lzma, 2),
        "unpacks to more than",
    ),
    "Zarr 2, blosc": (
        zarr_with(numcodecs.Blosc(), lambda: bytes(numcodecs.Blosc().encode(np.zeros(BOMB_BYTES, np.uint8))), 2),
        "unpacks to more than",
    ),
    "Zarr 2, LZ4": (
        zarr_with(numcodecs.LZ4(), lambda: bytes(numcodecs.LZ4().encode(np.zeros(BOMB_BYTES, np.uint8))), 2),
        "unpacks to more than",
    ),
    "HDF5": (lambda folder: hdf5(folder, False, False), "unpacks to more than"),
    "HDF5, shuffled": (lambda folder: hdf5(folder, True, False), "unpacks to more than"),
    "HDF5, with checksums": (lambda folder: hdf5(folder, True, True), "unpacks to more than"),
    "HDF5, chunks beyond the whole": (hdf5_of_great_chunks, "is stored in chunks of 536870912 bytes"),
    "TIFF, deflated": (lambda folder: tiff(folder, deflated(15), "zlib"), "unpacks to more than"),
    "TIFF, LZMA": (lambda folder: tiff(folder, by_lzma(), "lzma"), "unpacks to more"),
    "TIFF, tiles beyond the page": (tiff_of_great_tiles, "is stored in chunks of 3600000000 bytes"),
    "FITS, a tile": (fits_tile, "unpacks to more than"),
    "PDB": (text, "bytes of text unpacked"),
    "raw voxels": (raw_gzip, "but the file has more unpacked"),
}


def outcomes(volumes: list[Path]) -> tuple[list[str], int]:
    """What a process makes of the volumes, and how many MiB more it took at most."""
    done = subprocess.run(
        [sys.executable, CHILD, *volumes], capture_output=True, encoding="utf-8", timeout=PATIENCE, check=True
    )
    assert done.stderr == ""
    *lines, memory = done.stdout.splitlines()
    before, after = (int(number) for number in memory.split())
    return lines, after - before


def test_bombs_are_refused_in_one_line_and_in_little_memory(tmp_path: Path) -> None:
    volumes = []
    for n, (make, _) in enumerate(BOMBS.values()):
        (tmp_path / str(n)).mkdir()
        volumes.append(make(tmp_path / str(n)))
    lines, more = outcomes(volumes)
    for (name, (_, cause)), volume, line in zip(BOMBS.items(), volumes, lines, strict=True):
        assert line.startswith(f"refused: {volume}") and cause in line, (name, line)
    assert more < MOST_MORE


def test_bombs_in_tiff_for_imagecodecs_are_refused_too(tmp_path: Path) -> None:
    imagecodecs = pytest.importorskip("imagecodecs")
    volumes = []
    for codec, packed in (("zstd", zstandard()), ("lzw", bytes(imagecodecs.lzw_encode(bytes(1 << 24))))):
        (tmp_path / codec).mkdir()
        volumes.append(tiff(tmp_path / codec, packed, codec))
    lines, more = outcomes(volumes)
    for volume, line in zip(volumes, lines, strict=True):
        assert line.startswith(f"refused: {volume}") and "unpacks to more than" in line
    assert more < MOST_MORE


def test_streams_that_hold_more_than_is_wanted_are_read_so_far(tmp_path: Path) -> None:
    """One byte after the other, a stream needs no more memory than what is wanted of it."""
    packed = {"gzip": deflated(31), "bzip2": by_bzip2()}
    volumes = []
    for encoding, each in packed.items():
        (tmp_path / encoding).mkdir()
        volumes.append(nrrd(tmp_path / encoding, encoding, each))
    lines, more = outcomes(volumes)
    assert lines == ["read", "read"] and more < MOST_MORE


def test_codecs_that_run_programs_are_not_used(tmp_path: Path) -> None:
    array = zarr.create_array(
        tmp_path / "v.zarr", shape=(4, 4, 4), chunks=(4, 4, 4), dtype="uint8", compressors=None, zarr_format=2
    )
    array[...] = 1
    metadata = tmp_path / "v.zarr" / ".zarray"
    metadata.write_text(
        metadata.read_text(encoding="utf-8").replace('"compressor": null', '"compressor": {"id": "pickle"}')
    )
    with pytest.raises(BadInput, match="pickle"):
        open_volume(str(tmp_path / "v.zarr"))


@pytest.mark.parametrize(
    ("packed", "size"),
    [
        (bytes.fromhex("ffd8ffe000104a46494600010100000100010000ffc0000b080010002001011100"), (32, 16)),
        (bytes.fromhex("ffd8fff7000b08001000200101110000000000"), (32, 16)),
        (bytes.fromhex("ff4fff5100290000") + struct.pack(">4I", 60010, 50020, 10, 20), (60000, 50000)),
        (bytes(12) + bytes.fromhex("ff4fff5100290000") + struct.pack(">4I", 8, 9, 0, 0), (8, 9)),
        (b"\xff\xd8\xff", None),
        (b"none of these", None),
    ],
)
def test_codestreams_tell_the_size_that_they_promise(packed: bytes, size: tuple[int, int] | None) -> None:
    assert codestream_size(packed) == size
