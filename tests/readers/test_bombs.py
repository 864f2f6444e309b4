"""Small files that would unpack to gigabytes: that ends at what the header promises, and is refused in one line."""

from __future__ import annotations

import bz2
import gzip
import lzma
import struct
import subprocess
import sys
import zipfile
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
from support.files.opened import described
from support.patience import PATIENCE
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.bounded_unpacking import WINDOW, Damaged, TooMuch, inflated
from volsplat.mapshade_server.readers.reading.codestream_size import codestream_size
from volsplat.protocol.description.volume import Box
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


def zstandard_of_two_frames() -> bytes:
    return bytes(numcodecs.Zstd().encode(bytes(8**3))) + zstandard_of_unknown_size()


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


def deflated_first(folder: Path, then: Callable[[Any], object], packed: bytes) -> Path:
    """HDF5 whose filters stand in another order than h5py's: what `then` sets comes after deflation."""
    path = folder / "v.h5"
    with h5py.File(path, "w") as file:
        creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        creation.set_chunk((8, 8, 8))
        creation.set_deflate(9)
        then(creation)
        space = h5py.h5s.create_simple((16, 16, 16))
        made = h5py.h5d.create(file.id, b"v", h5py.h5t.NATIVE_UINT8, space, creation)
        h5py.Dataset(made)[...] = VALUES
        made.write_direct_chunk((0, 0, 0), packed)
    return path


def hdf5_scale(folder: Path) -> Path:
    path = folder / "v.h5"
    with h5py.File(path, "w") as file:
        made = file.create_dataset("v", data=VALUES)
        x = file.create_dataset("x", (16,), np.float32, chunks=(16,), compression="gzip")
        x.id.write_direct_chunk((0,), deflated(15))
        x.make_scale("x")
        made.dims[2].attach_scale(x)
    return path


def virtual(folder: Path, source: str = "v.h5", path: str = "v", to: str = "w.h5") -> Path:
    """Voxels that lie in another file, whose first chunk is a bomb."""
    hdf5(folder, False, False)
    layout = h5py.VirtualLayout((16, 16, 16), np.uint8)
    layout[...] = h5py.VirtualSource(source, path, (16, 16, 16))
    with h5py.File(folder / to, "w", libver="latest") as file:
        file.create_virtual_dataset("w", layout)
    return folder / to


def virtual_of_virtual(folder: Path) -> Path:
    virtual(folder)
    return virtual(folder, "w.h5", "w", "x.h5")


def virtual_of_numbered(folder: Path) -> Path:
    """Of files that are numbered from 0 on, of which the second one has a bomb."""
    (folder / "0.h5").write_bytes(hdf5(folder, False, False).read_bytes())
    with h5py.File(folder / "0.h5", "r+") as file:
        file["v"][:8] = 1
    (folder / "v.h5").rename(folder / "1.h5")
    dims, most = (32, 16, 16), (h5py.h5s.UNLIMITED, 16, 16)
    space = h5py.h5s.create_simple(dims, most)
    space.select_hyperslab((0, 0, 0), (h5py.h5s.UNLIMITED, 1, 1), (16, 1, 1), (16, 16, 16))
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_virtual(space, b"%b.h5", b"v", h5py.h5s.create_simple((16, 16, 16)))
    with h5py.File(folder / "w.h5", "w", libver="latest") as file:
        extent = h5py.h5s.create_simple(dims, most)
        h5py.h5d.create(file.id, b"w", h5py.h5t.NATIVE_UINT8, extent, creation)
    return folder / "w.h5"


def zarr_coordinates(folder: Path) -> Path:
    path = folder / "v.zarr"
    group = zarr.create_group(path)
    group.create_array("v", data=VALUES, dimension_names=("z", "y", "x"))
    group.create_array("x", data=np.arange(16.0), dimension_names=("x",), compressors=GzipCodec())
    (path / "x/c/0").write_bytes(deflated(31))
    return path


def npz_header(folder: Path) -> Path:
    path = folder / "v.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("v.npy", "w") as file:
        file.write(b"\x93NUMPY\x02\x00" + struct.pack("<I", BOMB_BYTES))
        for _ in range(BOMB_BYTES >> 22):
            file.write(b" " * (1 << 22))
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
    "Zarr, zstd of two frames": (zarr_with(ZstdCodec(), zstandard_of_two_frames), "unpacks to more than"),
    "Zarr, coordinates": (zarr_coordinates, "unpacks to more than"),
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
    "HDF5, shuffled once deflated": (
        lambda folder: deflated_first(folder, lambda one: one.set_shuffle(), deflated(15)),
        "unpacks to more than",
    ),
    "HDF5, deflated twice": (
        lambda folder: deflated_first(folder, lambda one: one.set_deflate(9), zlib.compress(deflated(15))),
        "unpacks to more than",
    ),
    "HDF5, packed once deflated": (
        lambda folder: deflated_first(folder, lambda one: one.set_filter(h5py.h5z.FILTER_LZF), deflated(15)),
        "then packed by filter 32000, so that nothing bounds it",
    ),
    "HDF5, virtual": (virtual, "unpacks to more than"),
    "HDF5, virtual of virtual": (virtual_of_virtual, "unpacks to more than"),
    "HDF5, virtual of numbered files": (virtual_of_numbered, "unpacks to more than"),
    "HDF5, virtual of itself": (lambda folder: virtual(folder, ".", "w"), "take theirs from others, without end"),
    "HDF5, coordinates": (hdf5_scale, "unpacks to more than"),
    "HDF5, chunks beyond the whole": (hdf5_of_great_chunks, "is stored in chunks of 536870912 bytes"),
    "TIFF, deflated": (lambda folder: tiff(folder, deflated(15), "zlib"), "unpacks to more than"),
    "TIFF, LZMA": (lambda folder: tiff(folder, by_lzma(), "lzma"), "unpacks to more"),
    "TIFF, tiles beyond the page": (tiff_of_great_tiles, "is stored in chunks of 3600000000 bytes"),
    "FITS, a tile": (fits_tile, "unpacks to more than"),
    "NumPy, a header": (npz_header, "its NumPy header cannot be read"),
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


def test_what_a_virtual_dataset_takes_from_elsewhere_is_bounded_by_itself_alone(tmp_path: Path) -> None:
    """Chunks that nothing wanted lies in are left alone, and so is a bomb among them."""
    hdf5(tmp_path, False, False)
    layout = h5py.VirtualLayout((12, 16, 1, 16), np.uint8)
    layout[:, :8, 0] = h5py.VirtualSource(tmp_path / "v.h5", "v", (16, 16, 16))[4:, 8:]
    layout[:, 8:, 0] = h5py.VirtualSource(tmp_path / "v.h5", "v", (16, 16, 16))[4:, :8]
    with h5py.File(tmp_path / "w.h5", "w", libver="latest") as file:
        file.create_virtual_dataset("w", layout)
    volume = open_volume(f"{tmp_path / 'w.h5'}#axis2=0")
    assert np.array_equal(volume.read(Box((0, 0, 0), (16, 8, 12))), VALUES[4:, 8:])
    assert np.array_equal(volume.read(Box((0, 8, 4), (16, 16, 12))), VALUES[8:, :8])
    with pytest.raises(BadInput, match="unpacks to more than"):
        volume.read(Box((0, 8, 0), (16, 9, 12)))


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


def test_coordinates_that_nobody_wrote_take_no_memory(tmp_path: Path) -> None:
    """A few bytes may promise any number of them."""
    count = 1 << 24
    with h5py.File(tmp_path / "v.h5", "w") as file:
        made = file.create_dataset("v", (1, 1, count), np.uint8, chunks=(1, 1, 1024))
        made[0, 0, :4] = 1
        x = file.create_dataset("x", (count,), np.float64, chunks=(1024,))
        x.make_scale("x")
        made.dims[2].attach_scale(x)
    group = zarr.create_group(tmp_path / "v.zarr")
    array = group.create_array(
        "v", shape=(1, 1, count), chunks=(1, 1, count >> 4), dtype="u1", dimension_names=("z", "y", "x")
    )
    array[0, 0, :4] = 1
    group.create_array("x", shape=(count,), chunks=(count >> 4,), dtype="f8", dimension_names=("x",))
    volumes = [tmp_path / "v.h5", tmp_path / "v.zarr"]
    lines, more = outcomes(volumes)
    assert lines == ["read", "read"] and more < MOST_MORE
    for volume in volumes:
        (warning,) = described(volume).warnings
        assert "x has more than" in warning


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("padding", [0, 1, WINDOW, 2 * WINDOW + 1])
@pytest.mark.parametrize("compress", [gzip.compress, zlib.compress])
def test_streams_after_each_other_unpack_as_one(compress: Callable[[bytes], bytes], padding: int, count: int) -> None:
    part = np.random.default_rng(0).integers(0, 99, WINDOW * 2 - 7, np.uint8).tobytes()
    packed = b"".join(compress(each) + bytes(padding) for each in [part, b""] * count)
    assert inflated(packed, len(part) * count) == part * count
    with pytest.raises(TooMuch):
        inflated(packed, len(part) * count - 1)
    with pytest.raises(Damaged):
        inflated(packed + b"no stream", len(part) * count)
    with pytest.raises(Damaged, match="truncated"):
        inflated(packed[: -padding - 3], len(part) * count)


def test_many_empty_streams_take_no_longer_than_their_bytes() -> None:
    """What follows a stream is not copied for each of them."""
    assert inflated(gzip.compress(b"") * 200_000, 100) == b""


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
