"""Voxels as they lie in files: raw or compressed, in one piece or several, in either byte order.

Only the rows of the wanted box are read from raw pieces. A compressed piece is unpacked up to the box's last sheet,
sheet by sheet, so that no more than the box stays in memory; a box that begins there or later goes on from there.
Nothing here knows a file format.
"""

import os
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from volsplat.mapshade_server.readers.reading.gzip_files import is_gzip
from volsplat.mapshade_server.readers.reading.unpacked_stream import MOST_GROWTH, Packing, UnpackedStream
from volsplat.mapshade_server.readers.reading.volume_files import DiskFile, disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels, voxel_room
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.text.errors import BadInput

# Between two wanted runs of bytes, a gap up to this size is read through: disks and file systems do so anyway.
READ_THROUGH_BYTES = 16384


BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"little": "<", "big": ">"}


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
    _paused: dict[Piece, UnpackedStream] = field(default_factory=dict, init=False, repr=False, compare=False)

    def files(self) -> tuple[DiskFile, ...]:
        """Of header and voxels."""
        return disk_files([self.source, *(piece.path for piece in self.pieces)])

    @property
    def packed(self) -> bool:
        return any(piece.packing != Packing.RAW for piece in self.pieces)

    @property
    def access(self) -> dict[str, Any]:
        """What a description says of how a box is read."""
        why_whole = "the file is compressed by gzip" if self.packed else ""
        return {"reads_sub_cubes": not self.packed, "chunk": self.chunk, "why_whole": why_whole}

    @property
    def chunk(self) -> Index:
        """Voxels along i, j, k that only come together: rows, as far as they are read through, or whole sheets."""
        if self.packed:
            return (self.dims[0], self.dims[1], 1)
        return (min(self.dims[0], max(READ_THROUGH_BYTES // self.dtype.itemsize, 1)), 1, 1)

    @property
    def sheet_bytes(self) -> int:
        return self.dims[0] * self.dims[1] * self.dtype.itemsize

    def check_there(self) -> None:
        """Raises BadInput if a piece's file is missing."""
        for piece in self.pieces:
            if not piece.path.is_file():
                raise BadInput(
                    f"{self.source}: its data file {piece.path.name} is missing; put it at {piece.path.parent}"
                )

    def check_files(self) -> None:
        """Raises BadInput if a piece's file is missing or cannot hold what the header promises."""
        self.check_there()
        for piece in self.pieces:
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
        """The voxels of `box`, in native byte order. Raises BadInput if the files end too early."""
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

    def read_from(self, sheet: int, box: Box) -> Voxels:
        """The voxels of a box of the volume that begins at this sheet."""
        (i0, j0, k0), (i1, j1, k1) = box
        return self.read(Box((i0, j0, sheet + k0), (i1, j1, sheet + k1)))

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
        start = piece.skipped + box.low[2] * self.sheet_bytes
        stream = self._paused.pop(piece, None)
        if stream is None or stream.passed > start:
            stream = UnpackedStream(piece.path, piece.offset, piece.packing)
        stream.drop(start - stream.passed)
        for n in range(box.size[2]):
            stream.fill(_bytes_of(sheet))
            into[n] = sheet[box.low[1] : box.high[1], box.low[0] : box.high[0]]
        self._paused[piece] = stream


def one_piece(
    source: Path, dims: Index, dtype: np.dtype[np.generic], start: int, data: Path | None = None
) -> StoredVoxels:
    """The voxels from byte `start` on of the file `data` or, if it is gzip, of what it unpacks to.

    Raises BadInput if the file is missing or cannot hold them.
    """
    held = data or source
    zipped = held.is_file() and is_gzip(held)
    piece = Piece(held, dims[2], 0, Packing.DEFLATE, start) if zipped else Piece(held, dims[2], start)
    voxels = StoredVoxels(source, dims, dtype, (piece,))
    voxels.check_files()
    return voxels


def unpacked_size(path: Path, offset: int, packing: Packing, most: int) -> int:
    """How many bytes a compressed file holds from `offset` on, found by unpacking it; of more than `most`, not all.

    Raises BadInput if it is broken.
    """
    try:
        return UnpackedStream(path, offset, packing).drain(most)
    except (OSError, EOFError, zlib.error) as error:
        raise BadInput(f"{path}: {_cause(error, None)}; fetch or export the volume again") from None


def fill(descriptor: int, into: Voxels, offset: int) -> None:
    """Reads exactly the bytes of `into`, which is contiguous, from the file's `offset` on.

    Raises EOFError if the file ends before.
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
