"""What the compressed tiles of a FITS image would unpack to, found before astropy unpacks them without an end."""

import math
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from volsplat.mapshade_server.readers.reading.bounded_unpacking import Damaged, inflated

BY_METHOD, BY_GZIP = "COMPRESSED_DATA", "GZIP_COMPRESSED_DATA"  # columns; the second if the method failed
GZIP_METHODS = ("GZIP_1", "GZIP_2")
HCOMPRESS, HCOMPRESS_MAGIC = "HCOMPRESS_1", b"\xdd\x99"
MOST_BYTES_A_PIXEL = 8
SLACK = 1 << 12
# Of a column of arrays: each has two of these, its length and its place in the heap.
DESCRIPTORS: dict[str, np.dtype[Any]] = {"P": np.dtype(">i4"), "Q": np.dtype(">i8")}


class _Column(NamedTuple):
    name: str
    offset: int  # in a row
    descriptor: "np.dtype[Any]"


def check_tiles_within(table: Any, tile_shape: Sequence[int], shape: Sequence[int], wanted: Sequence[slice]) -> None:
    """Raises ValueError if a tile that shares pixels with what is wanted unpacks to more than a tile has.

    `table` is the HDU as the table that it is stored as; shapes and what is wanted are in numpy's order of axes.
    """
    header, info = table.header, table.fileinfo()
    file, pixels = info["file"], math.prod(tile_shape)
    heap = info["datLoc"] + header.get("THEAP", header["NAXIS1"] * header["NAXIS2"])
    for number in _touched(tile_shape, shape, wanted):
        for column in _columns(table):
            file.seek(info["datLoc"] + number * header["NAXIS1"] + column.offset)
            length, place = np.frombuffer(file.read(2 * column.descriptor.itemsize), column.descriptor).tolist()
            if length > 0:
                file.seek(heap + place)
                _check(header["ZCMPTYPE"] if column.name == BY_METHOD else GZIP_METHODS[0], file.read(length), pixels)


def _touched(tile_shape: Sequence[int], shape: Sequence[int], wanted: Sequence[slice]) -> Iterator[int]:
    counts = [-(-length // tile) for length, tile in zip(shape, tile_shape, strict=True)]
    ranges = [range(part.start // tile, -(-part.stop // tile)) for part, tile in zip(wanted, tile_shape, strict=True)]
    for place in product(*ranges):
        number = 0
        for at, count in zip(place, counts, strict=True):
            number = number * count + at
        yield number


def _columns(table: Any) -> list[_Column]:
    columns = []
    for column in table.columns:
        kind = next((letter for letter in str(column.format) if letter in DESCRIPTORS), "")
        if column.name in (BY_METHOD, BY_GZIP) and kind:
            columns.append(_Column(column.name, table.columns.dtype.fields[column.name][1], DESCRIPTORS[kind]))
    return columns


def _check(method: str, packed: bytes, pixels: int) -> None:
    if method in GZIP_METHODS:
        inflated(packed, pixels * MOST_BYTES_A_PIXEL + SLACK)
    elif method == HCOMPRESS and packed.startswith(HCOMPRESS_MAGIC):
        stated = int.from_bytes(packed[2:6], "big", signed=True) * int.from_bytes(packed[6:10], "big", signed=True)
        if stated > pixels:
            raise Damaged(f"a tile states {stated} pixels, {pixels} are promised")
