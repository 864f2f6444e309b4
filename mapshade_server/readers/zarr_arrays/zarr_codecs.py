"""Zarr's codecs with a bound: a chunk unpacks to what its array promises, and not to gigabytes.

Codecs of version 3 get their own bound with each chunk. Those of version 2 know nothing of it: `at_most` gives it.
A codec that is not in the list is not used at all: some of them run programs that are stored in the chunk (pickle).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

import numpy as np
import zstandard

from volsplat.mapshade_server.readers.reading.bounded_unpacking import (
    Damaged,
    TooMuch,
    inflated,
    unpacked_bzip2,
    unpacked_lzma,
)
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.text.errors import BadInput

# What they put out is as large as what they take, or nearly so.
SIZE_KEEPING = (
    *("adler32", "astype", "base64", "bitround", "crc32", "crc32c", "delta", "fixedscaleoffset", "fletcher32"),
    *("jenkins_lookup3", "packbits", "quantize", "shuffle"),
)
BOUNDED = ("blosc", "bz2", "gzip", "lz4", "lzma", "zlib", "zstd")
SLACK = 2, 1 << 16  # times what is promised, and bytes: a packed part of a chain may be longer than its content

BLOSC_HEADER, BLOSC_SIZE, BLOSC_BLOCK = 16, slice(4, 8), slice(8, 12)
ZSTD_SKIPPED, ZSTD_HEADER, ZSTD_BLOCK = b"\x2a\x4d\x18", 18, 1 << 17  # bytes, at most

_most: ContextVar[int | None] = ContextVar("most bytes of a chunk, unpacked", default=None)


@contextmanager
def at_most(promised: int) -> Iterator[None]:
    """Chunks that are read within unpack to no more than what is promised, and some slack."""
    token = _most.set(_with_slack(promised))
    try:
        yield
    finally:
        _most.reset(token)


def _with_slack(promised: int) -> int:
    return promised * SLACK[0] + SLACK[1]


def check_codecs(whole: str, array: Any) -> None:
    """Raises BadInput if a version 2 array names a codec that may do anything."""
    filters = (*(getattr(array.metadata, "filters", None) or ()), getattr(array.metadata, "compressor", None))
    for codec in filters:
        if codec is not None and codec.codec_id not in (*SIZE_KEEPING, *BOUNDED):
            raise BadInput(f"{whole}: is stored by the codec “{codec.codec_id}”, which is not used; write it by zstd")


@contextmanager
def bounded_codecs() -> Iterator[None]:
    """Arrays that are opened within unpack their chunks within bounds."""
    zarr = library("zarr", "Zarr")
    registry = library("numcodecs.registry", "Zarr")
    for codec in _of_version_2():
        registry.register_codec(codec)
    names = {}
    for name, codec in _of_version_3().items():
        zarr.registry.register_codec(name, codec)
        names[f"codecs.{name}"] = f"{codec.__module__}.{codec.__qualname__}"
    with zarr.config.set(names):
        yield


def _unpack(codec_id: str, codec: Any, packed: memoryview, most: int) -> bytes | None:
    """What a codec of BOUNDED makes of packed bytes; None if it may do so itself. Raises ValueError for too much."""
    match codec_id:
        case "gzip" | "zlib":
            return inflated(packed, most)
        case "bz2":
            return unpacked_bzip2(packed, most)
        case "lzma" if codec is None or codec.format in (0, 1):
            return unpacked_lzma(packed, most)
    if _stated_size(codec_id, packed) > most:
        raise TooMuch(most)
    return None


def _stated_size(codec_id: str, packed: memoryview) -> int:
    """How many bytes packed ones become, or more, by what stands before them."""
    match codec_id:
        case "blosc":
            if len(packed) < BLOSC_HEADER:
                raise Damaged("its blosc header is truncated")
            return max(int.from_bytes(packed[part], "little") for part in (BLOSC_SIZE, BLOSC_BLOCK))
        case "lz4":
            return int.from_bytes(packed[:4], "little")
        case "zstd":
            return _zstd_size(packed)
    raise Damaged(f"its codec {codec_id} states no size")


def _zstd_size(packed: memoryview) -> int:
    """What all the frames become at most: libzstd unpacks them after each other, however many there are."""
    total = at = 0
    while at < len(packed):
        if packed[at + 1 : at + 4] == ZSTD_SKIPPED and packed[at] >> 4 == 5:
            at += 8 + int.from_bytes(packed[at + 4 : at + 8], "little")
        else:
            size, at = _zstd_frame(packed, at)
            total += size
    if at > len(packed):
        raise Damaged("its zstd frames are truncated")
    return total


def _zstd_frame(packed: memoryview, at: int) -> tuple[int, int]:
    """The size that the frame states, to which libzstd keeps, else what its blocks become at most; and its end."""
    start = packed[at : at + ZSTD_HEADER]
    try:
        stated = zstandard.get_frame_parameters(start)
        at += zstandard.frame_header_size(start)
    except zstandard.ZstdError:
        raise Damaged("its zstd frame is damaged") from None
    total, last = 0, False
    while not last:
        if at + 3 > len(packed):
            raise Damaged("its zstd frames are truncated")
        header = int.from_bytes(packed[at : at + 3], "little")
        last, kind, size = bool(header & 1), header >> 1 & 3, header >> 3
        total += ZSTD_BLOCK if kind == 2 else size
        at += 3 + (1 if kind == 1 else size)
    known = stated.content_size != zstandard.CONTENTSIZE_UNKNOWN
    return stated.content_size if known else total, at + 4 * stated.has_checksum


@cache
def _of_version_2() -> list[Any]:
    """The codecs of numcodecs, each with the bound of `at_most`."""
    registry = library("numcodecs.registry", "Zarr")

    def bounded(base: Any) -> Any:
        class Bounded(base):  # type: ignore[misc]
            def decode(self, buf: Any, out: Any = None) -> Any:
                most = _most.get()
                if most is None:
                    return super().decode(buf, out)
                unpacked = _unpack(self.codec_id, self, memoryview(buf).cast("B"), most)
                return super().decode(buf, out) if unpacked is None else unpacked

        Bounded.__name__ = Bounded.__qualname__ = base.__name__
        return Bounded

    return [bounded(type(registry.get_codec({"id": codec_id}))) for codec_id in BOUNDED]


@cache
def _of_version_3() -> dict[str, Any]:
    """Zarr's own codecs, each with the bound of its chunk."""
    import asyncio  # slow to import: a server that reads no Zarr starts without it

    codecs = library("zarr.codecs", "Zarr")

    def bounded(name: str, base: Any) -> Any:
        class Bounded(base):  # type: ignore[misc]
            async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
                most = _with_slack(int(np.prod(chunk_spec.shape, dtype=object)) * chunk_spec.dtype.item_size)
                unpacked = await asyncio.to_thread(_unpack, name, None, chunk_bytes.as_numpy_array().data, most)
                if unpacked is None:
                    return await super()._decode_single(chunk_bytes, chunk_spec)
                return chunk_spec.prototype.buffer.from_bytes(unpacked)

        Bounded.__qualname__ = Bounded.__name__ = f"Bounded{base.__name__}"
        return Bounded

    return {
        "blosc": bounded("blosc", codecs.BloscCodec),
        "gzip": bounded("gzip", codecs.GzipCodec),
        "zstd": bounded("zstd", codecs.ZstdCodec),
    }
