"""Voxels as they lie in files: raw or compressed, in one piece or several, in either byte order.

Only the rows of the wanted box are read from raw pieces. A compressed piece is unpacked up to the box's last sheet,
sheet by sheet, so that no more than the box stays in memory; a box that begins there or later goes on from there.
Nothing here knows a file format.
"""

import bz2
import os
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Protocol

import numpy as np

from volsplat.mapshade_server.readers.reading.volume_files import DiskFile, disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.mapshade_server.readers.reading.voxel_room import voxel_room
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.text.errors import BadInput

# Between two wanted runs of bytes, a gap up to this size is read through: disks and file systems do so anyway.
READ_THROUGH_BYTES = 16384
COMPRESSED_CHUNK_BYTES, UNPACKED_CHUNK_BYTES = 1 << 16, 1 << 20  # at a time, at most


class Packing(StrEnum):
    """How a piece's bytes are packed."""

    RAW = "raw"
    DEFLATE = "deflate"  # zlib or gzip framing, told apart by their first bytes
    BZIP2 = "bzip2"


# How many bytes one stored byte can become at most.
MOST_GROWTH = {Packing.RAW: 1, Packing.DEFLATE: 1032, Packing.BZIP2: 1 << 20}


@dataclass(frozen=True)
class Piece:
    """Consecutive k-sheets in one file: from `offset` on, after dropping `skipped` unpacked bytes."""

    path: Path
    sheets: int
    offset: int = 0
    packing: Packing = Packing.RAW
    skipped: int = 0


@dataclass(frozen=True)
class StoredVoxels:
    """A volume's voxels in files. `source` is the path that errors name, `dtype` has the file's byte order."""

    source: Path
    dims: Index
    dtype: np.dtype[np.generic]
    pieces: tuple[Piece, ...]
    _paused: "dict[Piece, _Paused]" = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def files(self) -> tuple[DiskFile, ...]:
        """Of header and voxels."""
        return disk_files([self.source, *(piece.path for piece in self.pieces)])

    @property
    def chunk(self) -> Index:
        """Voxels along i, j, k that only come together: rows, as far as they are read through, or whole sheets."""
        if any(piece.packing != Packing.RAW for piece in self.pieces):
            return (self.dims[0], self.dims[1], 1)
        return (min(self.dims[0], max(READ_THROUGH_BYTES // self.dtype.itemsize, 1)), 1, 1)

    @property
    def sheet_bytes(self) -> int:
        return self.dims[0] * self.dims[1] * self.dtype.itemsize

    def check_files(self) -> None:
        """Raises BadInput where a piece's file is missing or cannot hold what the header promises."""
        for piece in self.pieces:
            if not piece.path.is_file():
                raise BadInput(
                    f"{self.source}: its data file {piece.path.name} is missing; put it at {piece.path.parent}"
                )
            promised = piece.sheets * self.sheet_bytes
            there = max(piece.path.stat().st_size - piece.offset, 0)
            if there * MOST_GROWTH[piece.packing] < promised:
                packed = "" if piece.packing == Packing.RAW else " compressed"
                raise BadInput(
                    f"{self.source}: the header promises {promised} bytes of voxels, but "
                    f"{'the file' if piece.path == self.source else piece.path.name} holds only {there}{packed}; "
                    "it is truncated or the header's sizes are wrong"
                )

    def read(self, box: Box) -> Voxels:
        """The voxels of `box`, in native byte order. Raises BadInput where the files end too early."""
        voxels = voxel_room(box, self.dtype, self.source)
        first = 0  # of the piece's sheets, in the whole volume
        for piece in self.pieces:
            low, high = max(box.low[2], first), min(box.high[2], first + piece.sheets)
            if low < high:
                part = voxels[low - box.low[2] : high - box.low[2]]
                within = Box((*box.low[:2], low - first), (*box.high[:2], high - first))
                try:
                    if piece.packing == Packing.RAW:
                        self._read_raw(piece, within, part)
                    else:
                        self._unpack(piece, within, part)
                except (OSError, EOFError, zlib.error) as error:
                    raise BadInput(f"{self.source}: {_cause(error, piece)}; fetch or export the volume again") from None
            first += piece.sheets
        if not self.dtype.isnative:
            voxels = voxels.byteswap(inplace=True).view(self.dtype.newbyteorder("="))
        return voxels

    def _read_raw(self, piece: Piece, box: Box, into: Voxels) -> None:
        row_bytes = self.dims[0] * self.dtype.itemsize
        left = box.low[0] * self.dtype.itemsize
        whole_rows = box.size[0] == self.dims[0]
        gap = row_bytes - box.size[0] * self.dtype.itemsize
        with piece.path.open("rb", buffering=0) as file:
            if whole_rows and box.size[1] == self.dims[1]:
                fill(file.fileno(), into, piece.offset + box.low[2] * self.sheet_bytes)
                return
            through = np.empty((box.size[1], self.dims[0]), self.dtype)
            for sheet, k in zip(into, range(box.low[2], box.high[2]), strict=True):
                start = piece.offset + k * self.sheet_bytes + box.low[1] * row_bytes
                if whole_rows:
                    fill(file.fileno(), sheet, start)
                elif gap <= READ_THROUGH_BYTES:
                    fill(file.fileno(), through, start)
                    sheet[...] = through[:, box.low[0] : box.high[0]]
                else:
                    for n, row in enumerate(sheet):
                        fill(file.fileno(), row, start + n * row_bytes + left)

    def _unpack(self, piece: Piece, box: Box, into: Voxels) -> None:
        sheet = np.empty((self.dims[1], self.dims[0]), self.dtype)
        with piece.path.open("rb") as file:
            paused = self._paused.pop(piece, None)
            if paused is not None and paused.sheet <= box.low[2]:
                file.seek(paused.position)
                stream = paused.stream
                stream.go_on(file.read)
                stream.drop((box.low[2] - paused.sheet) * self.sheet_bytes)
            else:
                file.seek(piece.offset)
                stream = _Unpacking(file.read, piece.packing)
                stream.drop(piece.skipped + box.low[2] * self.sheet_bytes)
            for n in range(box.size[2]):
                stream.fill(_bytes_of(sheet))
                into[n] = sheet[box.low[1] : box.high[1], box.low[0] : box.high[0]]
            self._paused[piece] = _Paused(stream, file.tell(), box.high[2])


def unpacked_size(path: Path, offset: int, packing: Packing, most: int) -> int:
    """How many bytes a compressed file holds from `offset` on, found by unpacking it; of more than `most`, not all.

    Raises BadInput where it is broken.
    """
    with path.open("rb") as file:
        file.seek(offset)
        stream = _Unpacking(file.read, packing)
        try:
            return stream.drain(most)
        except (OSError, EOFError, zlib.error) as error:
            raise BadInput(f"{path}: {_cause(error, None)}; fetch or export the volume again") from None


def fill(descriptor: int, into: Voxels, offset: int) -> None:
    """Reads exactly the bytes of `into`, which is contiguous, from the file's `offset` on.

    Raises EOFError where the file ends before.
    """
    view = _bytes_of(into)
    while view:
        got = os.preadv(descriptor, [view], offset)
        if got == 0:
            raise EOFError
        view = view[got:]
        offset += got


def _bytes_of(voxels: Voxels) -> memoryview:
    """The contiguous bytes of an array of either byte order."""
    return voxels.view(np.uint8).data.cast("B")


def _cause(error: Exception, piece: Piece | None) -> str:
    where = "the file" if piece is None else piece.path.name
    if isinstance(error, EOFError):
        return f"{where} is truncated, it ends before its voxels do"
    if isinstance(error, OSError) and error.errno:
        return f"{where} cannot be read ({os.strerror(error.errno)})"
    return f"the compressed data of {where} is damaged"


class _Decompressor(Protocol):
    """What bz2's objects have, and zlib's are given: no more than `most` bytes come at a time."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, most: int, /) -> bytes: ...


class _Inflating:
    """A zlib or gzip stream."""

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


class _Unpacking:
    """A stream of unpacked bytes; several compressed streams after each other count as one, as gzip has it."""

    def __init__(self, read: Callable[[int], bytes], packing: Packing) -> None:
        self._read = read
        self._packing = packing
        self._decompressor = self._new()
        self._ready = memoryview(b"")

    def _new(self) -> _Decompressor:
        return bz2.BZ2Decompressor() if self._packing == Packing.BZIP2 else _Inflating()

    def _more(self) -> bool:
        """Unpacks some more bytes into `_ready`, which is used up; False at the orderly end."""
        while not self._ready:
            packed = b""
            if self._decompressor.eof:
                packed = self._decompressor.unused_data or self._read(COMPRESSED_CHUNK_BYTES)
                if not packed:
                    return False
                self._decompressor = self._new()
            elif self._decompressor.needs_input:
                packed = self._read(COMPRESSED_CHUNK_BYTES)
                if not packed:
                    raise EOFError
            self._ready = memoryview(self._decompressor.decompress(packed, UNPACKED_CHUNK_BYTES))
        return True

    def go_on(self, read: Callable[[int], bytes]) -> None:
        """Read on from the same file, opened again."""
        self._read = read

    def fill(self, into: memoryview) -> None:
        """Fills `into`. Raises EOFError where the stream ends first, zlib.error or OSError where it is damaged."""
        while into:
            if not self._more():
                raise EOFError
            count = min(len(into), len(self._ready))
            into[:count] = self._ready[:count]
            into, self._ready = into[count:], self._ready[count:]

    def drop(self, count: int) -> None:
        while count > 0:
            if not self._more():
                raise EOFError
            dropped = min(count, len(self._ready))
            self._ready = self._ready[dropped:]
            count -= dropped

    def drain(self, most: int) -> int:
        count = 0
        while count <= most and self._more():
            count += len(self._ready)
            self._ready = memoryview(b"")
        return count


@dataclass(frozen=True)
class _Paused:
    """Where the unpacking of a piece stopped: before this sheet, with so much of the file read."""

    stream: _Unpacking
    position: int
    sheet: int
