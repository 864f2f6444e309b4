"""A compressed file as a stream of its unpacked bytes, a little at a time."""

import bz2
import os
import zlib
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path

PACKED_CHUNK_BYTES, UNPACKED_CHUNK_BYTES = 1 << 16, 1 << 20  # at a time, at most


class Packing(StrEnum):
    """How bytes are packed."""

    RAW = "raw"
    DEFLATE = "deflate"  # zlib or gzip framing, told apart by their first bytes
    BZIP2 = "bzip2"


# How many bytes one stored byte can become at most.
MOST_GROWTH = {Packing.RAW: 1, Packing.DEFLATE: 1032, Packing.BZIP2: 1 << 20}


class _Inflating:
    """A zlib or gzip stream, with what bz2's objects have: no more than `most` bytes come at a time."""

    def __init__(self) -> None:
        self._stream = zlib.decompressobj(zlib.MAX_WBITS | 32)  # which lets zlib accept both framings
        self.needs_input = True

    @property
    def eof(self) -> bool:
        return self._stream.eof

    @property
    def unused_data(self) -> bytes:
        return self._stream.unused_data

    def decompress(self, data: bytes, most: int) -> bytes:
        unpacked = self._stream.decompress(self._stream.unconsumed_tail + data, most)
        self.needs_input = len(unpacked) < most and not self._stream.unconsumed_tail
        return unpacked


class UnpackedStream:
    """What a file unpacks to from `offset` on; several compressed streams after each other count as one, as in gzip.

    The file is open only while it is read. Every method raises zlib.error or OSError if what is packed is damaged.
    """

    def __init__(self, path: Path, offset: int, packing: Packing) -> None:
        self.passed = 0  # unpacked bytes so far
        self._path, self._offset = path, offset
        self._start = bz2.BZ2Decompressor if packing == Packing.BZIP2 else _Inflating
        self._decompressor = self._start()
        self._ready = memoryview(b"")

    def fill(self, into: memoryview) -> None:
        """Fills `into`. Raises EOFError if the stream ends first."""
        for part in self._taken(len(into)):
            into[: len(part)] = part
            into = into[len(part) :]

    def drop(self, count: int) -> None:
        """Passes over so many bytes. Raises EOFError if the stream ends first."""
        for _ in self._taken(count):
            pass

    def drain(self, most: int) -> int:
        """Passes over all that follows, or a little more than `most` bytes, and says how much that was."""
        before = self.passed
        while self.passed - before <= most and self._more():
            self.drop(len(self._ready))
        return self.passed - before

    def _taken(self, count: int) -> Iterator[memoryview]:
        while count > 0:
            if not self._more():
                raise EOFError
            part, self._ready = self._ready[:count], self._ready[count:]
            count -= len(part)
            self.passed += len(part)
            yield part

    def _more(self) -> bool:
        """Unpacks more bytes into `_ready` if that is used up; False at the orderly end."""
        while not self._ready:
            packed = b""
            if self._decompressor.eof:
                packed = self._following()
                if not packed:
                    return False
                self._decompressor = self._start()
            elif self._decompressor.needs_input:
                packed = self._read()
                if not packed:
                    raise EOFError
            self._ready = memoryview(self._decompressor.decompress(packed, UNPACKED_CHUNK_BYTES))
        return True

    def _following(self) -> bytes:
        """What follows the end of a stream but for zeros, by which gzip may be padded; nothing at the file's end."""
        packed = self._decompressor.unused_data.lstrip(b"\0")
        while not packed:
            if not (read := self._read()):
                return b""
            packed = read.lstrip(b"\0")
        return packed

    def _read(self) -> bytes:
        with self._path.open("rb", buffering=0) as file:
            packed = os.pread(file.fileno(), PACKED_CHUNK_BYTES, self._offset)
        self._offset += len(packed)
        return packed
