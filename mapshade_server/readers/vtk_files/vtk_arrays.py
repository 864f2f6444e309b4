"""How VTK's XML files store an array's numbers: as text, in base64 or raw, plain or in compressed blocks.

https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html. Raw numbers are read by the rows, and raw
compressed ones by the blocks, that a box needs. The others are taken from the XML as a whole, at first use.
"""

import binascii
import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from volsplat.mapshade_server.readers.reading.bounded_unpacking import inflated, unpacked_lzma
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, Voxels, boxes_of, voxel_room
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.text.errors import BadInput


class Compressor(NamedTuple):
    """`unpack` makes of a block no more bytes than it should become, or raises ValueError."""

    unpack: Callable[[bytes, int], bytes]
    most_growth: int  # of one byte


COMPRESSORS = {
    "vtkZLibDataCompressor": Compressor(inflated, 1032),
    "vtkLZMADataCompressor": Compressor(unpacked_lzma, 1 << 14),
}


@dataclass(frozen=True)
class VtkArray:
    """The array of a file that is to be read. `start` is where its text or bytes begin in the file."""

    path: Path
    dims: Index
    dtype: np.dtype[np.generic]  # in the file's byte order, as is the next
    length_type: np.dtype[np.generic]  # of the numbers that state lengths before binary ones
    start: int

    @property
    def nbytes(self) -> int:
        return self.dims[0] * self.dims[1] * self.dims[2] * self.dtype.itemsize

    def check_length(self, stated: int) -> None:
        """Raises BadInput unless the array is stated to be as long as its extent."""
        if stated != self.nbytes:
            raise self.damaged(f"its extent promises {self.nbytes} bytes of voxels, but the array states {stated}")

    def damaged(self, why: str) -> BadInput:
        return BadInput(f"{self.path}: {why}; the file is truncated or damaged, save or fetch it again")


def stored_voxels(array: VtkArray) -> StoredVoxels:
    """Raw numbers behind their length. Raises BadInput if they are not as many as the extent has."""
    with opened(array.path) as file:
        file.seek(array.start)
        (length,) = _lengths(array, _raw(array, file, array.length_type.itemsize))
    array.check_length(length)
    pieces = (Piece(array.path, array.dims[2], array.start + array.length_type.itemsize),)
    voxels = StoredVoxels(array.path, array.dims, array.dtype, pieces)
    voxels.check_files()
    return voxels


def text_voxels(array: VtkArray, end: int) -> ReadBox:
    """Reads numbers that are written out, up to the file's place `end`."""

    def whole() -> Voxels:
        with opened(array.path) as file:
            file.seek(array.start)
            text = file.read(end - array.start)
        try:
            with warnings.catch_warnings(action="error"):  # numpy only warns of what is no number
                numbers = np.fromstring(text, array.dtype.newbyteorder("="), sep=" ")
        except (ValueError, DeprecationWarning):
            raise array.damaged(f"its voxels are not all numbers of type {array.dtype.name}") from None
        if len(numbers) != (count := array.nbytes // array.dtype.itemsize):
            raise array.damaged(f"its extent promises {count} voxels, but the array has {len(numbers)}")
        return numbers.reshape(array.dims[::-1])

    return boxes_of(whole)


def base64_voxels(array: VtkArray) -> ReadBox:
    """Reads numbers in base64 behind their length, not compressed."""

    def whole() -> Voxels:
        before = array.length_type.itemsize
        with opened(array.path) as file:
            file.seek(array.start)
            array.check_length(*_lengths(array, _base64(array, file, before)))
            file.seek(array.start)
            numbers = np.frombuffer(_base64(array, file, before + array.nbytes), array.dtype, offset=before)
        return numbers.astype(array.dtype.newbyteorder("=")).reshape(array.dims[::-1])

    return boxes_of(whole)


class BlockVoxels:
    """Numbers in compressed blocks, each unpacked when a box needs it."""

    def __init__(self, array: VtkArray, compressor: Compressor, base64: bool) -> None:
        self._array = array
        self._unpack = compressor.unpack
        self._base64 = base64
        self._unpacked = (-1, b"")  # the last block, and its number
        take, itemsize = _base64 if base64 else _raw, array.length_type.itemsize
        with opened(array.path) as file:
            file.seek(array.start)
            count, self._block_bytes, last_bytes = _lengths(array, take(array, file, 3 * itemsize))
            file.seek(array.start)
            packed = _lengths(array, take(array, file, (3 + count) * itemsize))[3:]
            self._start = file.tell()
        self._sizes = [self._block_bytes] * count
        if count and last_bytes:
            self._sizes[-1] = last_bytes
        array.check_length(sum(self._sizes))
        self._bounds = [0, *itertools.accumulate(packed)]
        there = array.path.stat().st_size - self._start
        if not 0 < max(self._sizes) <= self._block_bytes or there < self._bounds[-1]:
            raise array.damaged(f"the array states {self._bounds[-1]} compressed bytes, but {there} follow")
        if self._bounds[-1] * compressor.most_growth < array.nbytes:
            raise array.damaged(f"its {self._bounds[-1]} compressed bytes cannot become {array.nbytes}")

    @cached_property
    def _packed(self) -> bytes:
        """All blocks as they were before base64."""
        with opened(self._array.path) as file:
            file.seek(self._start)
            return _base64(self._array, file, self._bounds[-1])

    def _block(self, n: int) -> bytes:
        if n != self._unpacked[0]:
            low, high = self._bounds[n : n + 2]
            try:
                block = self._unpack(self._packed[low:high] if self._base64 else self._read(low, high), self._sizes[n])
            except ValueError:
                block = b""
            if len(block) != self._sizes[n]:
                raise self._array.damaged(f"block {n + 1} of its compressed voxels cannot be unpacked")
            self._unpacked = (n, block)
        return self._unpacked[1]

    def _read(self, low: int, high: int) -> bytes:
        with self._array.path.open("rb", buffering=0) as file:
            file.seek(self._start + low)
            return _raw(self._array, file, high - low)

    def _bytes(self, low: int, high: int) -> bytes:
        """A range of the bytes that were compressed."""
        first = low // self._block_bytes
        blocks = [self._block(n) for n in range(first, (high - 1) // self._block_bytes + 1)]
        return b"".join(blocks)[low - first * self._block_bytes : high - first * self._block_bytes]

    def read(self, box: Box) -> Voxels:
        (i0, j0, k0), (i1, j1, k1) = box
        ni, nj, _ = self._array.dims
        dtype = self._array.dtype
        voxels = voxel_room(box, dtype.newbyteorder("="), self._array.path)
        for n, k in enumerate(range(k0, k1)):
            rows = self._bytes((k * nj + j0) * ni * dtype.itemsize, (k * nj + j1) * ni * dtype.itemsize)
            voxels[n] = np.frombuffer(rows, dtype).reshape(j1 - j0, ni)[:, i0:i1]
        return voxels


def _lengths(array: VtkArray, raw: bytes) -> list[int]:
    numbers: list[int] = np.frombuffer(raw, array.length_type).tolist()
    return numbers


def _raw(array: VtkArray, file: BinaryIO, count: int) -> bytes:
    """The next `count` bytes."""
    _check_left(array, file, count)
    return file.read(count)


def _base64(array: VtkArray, file: BinaryIO, count: int) -> bytes:
    """The next `count` bytes, which are a base64 text of their own; or the first ones of such a text."""
    need = -(-count // 3) * 4
    _check_left(array, file, need)
    text = b""
    while len(text) < need and (more := file.read(need - len(text))):
        text += b"".join(more.split())
    try:
        decoded = binascii.a2b_base64(text, strict_mode=True)[:count]
    except binascii.Error:
        decoded = b""
    if len(decoded) < count:
        raise array.damaged("its base64 text is no such text")
    return decoded


def _check_left(array: VtkArray, file: BinaryIO, count: int) -> None:
    left = max(array.path.stat().st_size - file.tell(), 0)
    if left < count:
        raise array.damaged(f"the array states {count} bytes, but {left} follow")
