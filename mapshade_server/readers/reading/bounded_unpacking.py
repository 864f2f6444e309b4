"""Unpacking that ends at the size that a header promises: what goes on is refused, never held.

A few kilobytes may unpack to more than any memory. Nothing here knows a file format.
"""

import bz2
import lzma
import zlib

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.text.errors import BadInput

LZMA_MEMORY = 1 << 28
WINDOW = 1 << 14  # bytes of a stream at a time: what follows its end is copied
LARGE_CHUNK, MOST_BEYOND = 1 << 26, 8  # bytes; times the whole, which a chunk at the edge may exceed


Packed = bytes | memoryview


class TooMuch(ValueError):
    """What is packed is more than was promised."""

    def __init__(self, most: int) -> None:
        super().__init__(f"it unpacks to more than the {most} bytes that are promised")


class Damaged(ValueError):
    """What is packed cannot be unpacked, or ends too early."""


def check_promise(source: object, chunk_bytes: int, whole_bytes: int) -> None:
    """Raises BadInput if one chunk, strip or tile is promised to be far more than the whole that it is a part of."""
    if chunk_bytes > max(LARGE_CHUNK, MOST_BEYOND * whole_bytes):
        raise BadInput(
            f"{source}: is stored in chunks of {chunk_bytes} bytes, though it has {whole_bytes} in all; "
            "the file is damaged or made to do harm"
        )


def inflated(packed: Packed, most: int) -> bytes:
    """Zlib or gzip streams, told apart by their first bytes, several after each other as one. Raises ValueError."""
    parts: list[bytes] = []
    left, at, whole = most, 0, memoryview(packed)
    stream = zlib.decompressobj(zlib.MAX_WBITS | 32)
    while at < len(whole):
        window = whole[at : at + WINDOW]
        try:
            part = stream.decompress(window, left + 1)
        except zlib.error as error:
            raise Damaged(f"its deflated bytes are damaged ({error})") from None
        left -= len(part)
        if left < 0:
            raise TooMuch(most)
        parts.append(part)
        at += len(window) - len(stream.unused_data)
        if stream.eof and (at := _after_zeros(whole, at)) < len(whole):
            stream = zlib.decompressobj(zlib.MAX_WBITS | 32)
    if packed and not stream.eof:
        raise Damaged("its deflated bytes are truncated")
    return b"".join(parts)


def _after_zeros(packed: memoryview, at: int) -> int:
    """Where the zeros end by which gzip may be padded."""
    while at < len(packed):
        window = bytes(packed[at : at + WINDOW])
        rest = window.lstrip(b"\0")
        at += len(window) - len(rest)
        if rest:
            break
    return at


def unpacked_bzip2(packed: Packed, most: int) -> bytes:
    """Raises ValueError."""
    return _unpacked(bz2.BZ2Decompressor(), "bzip2", packed, most)


def unpacked_lzma(packed: Packed, most: int) -> bytes:
    """The xz or old LZMA format. Raises ValueError."""
    return _unpacked(lzma.LZMADecompressor(memlimit=LZMA_MEMORY), "LZMA", packed, most)


def unpacked_by_imagecodecs(codec: str, packed: Packed, most: int) -> bytes:
    """By its decoder of that name, as lzw, packbits or zstd, into a room of that size. Raises ValueError."""
    decode = getattr(library("imagecodecs", f"what is packed by {codec}"), f"{codec}_decode")
    try:
        unpacked = bytes(decode(packed, out=most + 1))
    except RuntimeError as error:  # which does not distinguish a room too small from damage
        raise Damaged(f"it unpacks to more than the {most} bytes that are promised, or is damaged: {error}") from None
    if len(unpacked) > most:
        raise TooMuch(most)
    return unpacked


def _unpacked(stream: bz2.BZ2Decompressor | lzma.LZMADecompressor, kind: str, packed: Packed, most: int) -> bytes:
    try:
        unpacked = stream.decompress(packed, most + 1)
    except (OSError, lzma.LZMAError) as error:
        raise Damaged(f"its {kind} bytes are damaged ({error})") from None
    if len(unpacked) > most:
        raise TooMuch(most)
    if not stream.eof:
        raise Damaged("its packed bytes are truncated")
    return unpacked
