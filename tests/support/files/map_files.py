"""CCP4 and MRC maps for the tests of their reader: made here word for word, in ways that gemmi does not write."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels

MODES = {"int8": 0, "uint8": 0, "int16": 1, "float32": 2, "uint16": 6, "float16": 12}
STAMPS = {"<": b"\x44\x44\0\0", ">": b"\x11\x11\0\0"}
CELL = (17.5, 24.0, 40.0, 80.0, 100.0, 115.0)  # with no right angle


def map_header(
    sizes: Sequence[int],
    order: Literal["<", ">"] = "<",
    *,
    mode: int = 2,
    starts: Sequence[int] = (0, 0, 0),
    intervals: Sequence[int] = (20, 24, 50),
    cell: Sequence[float] = CELL,
    axes: Sequence[int] = (1, 2, 3),
    limits: tuple[float, float] = (0.0, 0.0),
    space_group: int = 1,
    extended: int = 0,
    skewed: int = 0,
    imod: tuple[int, int] = (0, 0),
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    magic: bytes = b"MAP ",
    stamp: bytes | None = None,
) -> bytes:
    """The 1024 bytes before the voxels; sizes, starts and axes in the order of columns, rows, sections."""
    words = struct.pack(
        f"{order}10i6f3i3f2i", *sizes, mode, *starts, *intervals, *cell, *axes, *limits, 0.0, space_group, extended
    )
    words += struct.pack(f"{order}14i", skewed, *[0] * 13) + struct.pack(f"{order}2i", *imod) + bytes(36)
    words += struct.pack(f"{order}3f", *origin) + magic + (STAMPS[order] if stamp is None else stamp)
    return words.ljust(1024, b"\0")


def map_file(path: Path, values: Voxels, header: bytes | None = None, extended: bytes = b"") -> Path:
    """A little-endian map of `values` (k, j, i), or one with this header; the values are written as they are."""
    if header is None:
        mode = MODES[values.dtype.name]
        header = map_header(values.shape[::-1], mode=mode, extended=len(extended))
    path.write_bytes(header + extended + values.tobytes())
    return path


def map_values(scalar_type: str, dims: tuple[int, int, int] = (7, 6, 5)) -> Voxels:
    """Every voxel different, as far as the type tells them apart."""
    count = dims[0] * dims[1] * dims[2]
    kind = np.dtype(scalar_type)
    low = -count // 4 if kind.kind in "if" else 0
    return (np.arange(count) // 2 + low).astype(kind).reshape(dims[::-1])
