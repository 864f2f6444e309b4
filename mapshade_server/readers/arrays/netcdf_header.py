"""The header of classic NetCDF files, versions 1, 2 and 5: which variables there are, and where their numbers lie.

https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html. It is read here since the library
(netCDF-C 4.9) gives zeros for what a truncated file lacks, without a word.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from volsplat.mapshade_server.readers.arrays.array_values import Attributes
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.protocol.text.errors import BadInput

MAGIC = b"CDF"
VERSIONS = (1, 2, 5)  # 2 has offsets of 64 bits, 5 lengths too
DIMENSIONS, VARIABLES, ATTRIBUTES = 10, 11, 12  # tags of lists
TYPES = {1: "i1", 2: "S1", 3: "i2", 4: "i4", 5: "f4", 6: "f8", 7: "u1", 8: "u2", 9: "u4", 10: "i8", 11: "u8"}
STREAMED = {4: 0xFFFFFFFF, 8: 0xFFFFFFFFFFFFFFFF}  # records whose number is not stated, by the bytes of a length
MOST_ELEMENTS = 1 << 20  # of a list, or bytes of a name
PADDING = 4


@dataclass(frozen=True)
class Variable:
    """Numbers on axes; if the first one counts records, each record lies `record_bytes` after the one before."""

    name: str
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: "np.dtype[Any]"
    attributes: Attributes
    begin: int
    record_bytes: int = 0  # 0 if it is in one piece

    @property
    def end(self) -> int:
        """Where it ends in the file."""
        if not self.record_bytes:
            return self.begin + math.prod(self.shape) * self.dtype.itemsize
        last = self.begin + max(self.shape[0] - 1, 0) * self.record_bytes
        return last + (math.prod(self.shape[1:]) * self.dtype.itemsize if self.shape[0] else 0)


def netcdf_variables(path: Path) -> dict[str, Variable]:
    """The variables by their names. Raises BadInput if the header is damaged or truncated."""
    with opened(path) as file:
        return _Header(path, file).variables()


class _Header:
    """Reads the header from its beginning on."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        self._size = path.stat().st_size
        version = file.read(4)[3]
        if version not in VERSIONS:
            raise self._damaged(f"its version is {version}, not one of {', '.join(map(str, VERSIONS))}")
        self._length_bytes = 8 if version == 5 else 4
        self._offset_bytes = 4 if version == 1 else 8

    def variables(self) -> dict[str, Variable]:
        records = self._number(self._length_bytes)
        dimensions = [(self._name(), self._length()) for _ in range(self._list(DIMENSIONS))]
        for _ in range(self._list(ATTRIBUTES)):
            self._attribute()
        stated = [self._variable(dimensions) for _ in range(self._list(VARIABLES))]
        of_records = [one for one in stated if one.shape[:1] == (0,)]
        sizes = [math.prod(one.shape[1:]) * one.dtype.itemsize for one in of_records]
        record = sizes[0] if len(sizes) == 1 else sum(-(-size // PADDING) * PADDING for size in sizes)
        if records == STREAMED[self._length_bytes]:
            first = min((one.begin for one in of_records), default=self._size)
            records = max(self._size - first, 0) // record if record else 0
        in_full = [replace(one, shape=(records, *one.shape[1:]), record_bytes=record) for one in of_records]
        return {one.name: one for one in (*stated, *in_full)}

    def _variable(self, dimensions: list[tuple[str, int]]) -> Variable:
        """A variable as the header has it, before the number of records is known, which stands as 0."""
        name = self._name()
        axes = [self._number(self._length_bytes) for _ in range(self._length())]
        if any(axis >= len(dimensions) for axis in axes):
            raise self._damaged(f"the variable {name} is on axes that there are not")
        attributes = dict(self._attribute() for _ in range(self._list(ATTRIBUTES)))
        dtype = self._dtype()
        self._number(self._length_bytes)  # its bytes, which are not stated if they are many
        names, lengths = [dimensions[n][0] for n in axes], [dimensions[n][1] for n in axes]
        return Variable(name, tuple(names), tuple(lengths), dtype, attributes, self._number(self._offset_bytes))

    def _attribute(self) -> tuple[str, Any]:
        name, dtype, count = self._name(), self._dtype(), self._length()
        size = count * dtype.itemsize
        raw = self._bytes(-(-size // PADDING) * PADDING)[:size]
        if dtype.kind == "S":
            return name, raw.decode("utf-8", "replace").rstrip("\0")
        numbers = np.frombuffer(raw, dtype).tolist()
        return name, numbers[0] if len(numbers) == 1 else numbers

    def _dtype(self) -> "np.dtype[Any]":
        code = self._number(4)
        if code not in TYPES:
            raise self._damaged(f"it has a type {code}, which there is not")
        return np.dtype(TYPES[code]).newbyteorder(">")

    def _name(self) -> str:
        size = self._length()
        return self._bytes(-(-size // PADDING) * PADDING)[:size].decode("utf-8", "replace")

    def _list(self, expected: int) -> int:
        """How many elements the list has that begins here."""
        tag, count = self._number(4), self._length()
        if tag != expected and (tag, count) != (0, 0):
            raise self._damaged(f"a list has the tag {tag} instead of {expected}")
        if count > MOST_ELEMENTS:
            raise self._damaged(f"a list has {count} elements")
        return count

    def _length(self) -> int:
        return self._number(self._length_bytes)

    def _number(self, count: int) -> int:
        return int.from_bytes(self._bytes(count), "big")

    def _bytes(self, count: int) -> bytes:
        if count > self._size - self._file.tell():
            raise self._damaged("its header goes on beyond its end")
        return self._file.read(count)

    def _damaged(self, why: str) -> BadInput:
        return BadInput(f"{self._path}: {why}; the file is truncated or damaged, fetch or export it again")
