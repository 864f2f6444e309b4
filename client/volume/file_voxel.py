"""A voxel as the volume's file has it, which may be more than the 8 bits say that it is drawn with."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from volsplat.protocol.description.volume import Index
from volsplat.protocol.text.errors import BadInput

CODES = {  # of the struct module
    "uint8": "B",
    "int8": "b",
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "uint64": "Q",
    "int64": "q",
    "float32": "f",
    "float64": "d",
}
SINGLE_DIGITS = range(6, 10)  # decimal ones, of which the last always tells a float32 from all others


@dataclass(frozen=True)
class FileVoxel:
    """Whole numbers are int, all others float; NaN where the file has no data."""

    density: int | float
    second: int | float | None = None  # of a volume with two numbers a voxel
    scalar_types: tuple[str, ...] = ("float64", "float64")

    @classmethod
    def of_bytes(cls, scalar_types: Sequence[str], payload: memoryview) -> FileVoxel:
        """As one of the servers sends it: one number or two."""
        density, *second = struct.unpack("<" + "".join(CODES[scalar] for scalar in scalar_types), payload)
        return cls(density, second[0] if second else None, tuple(scalar_types))

    @property
    def digits(self) -> tuple[str, ...]:
        """Each number in as many digits as it has: as few as tell it from all others of its type."""
        numbers = [self.density] if self.second is None else [self.density, self.second]
        return tuple(_digits(number, of) for number, of in zip(numbers, self.scalar_types, strict=False))


def check_is_voxel(index: Index, dims: Index) -> None:
    """Raises BadInput if a volume of this grid has no such voxel."""
    if not all(0 <= at < size for at, size in zip(index, dims, strict=True)):
        raise BadInput(f"there is no voxel {index} in a volume of {dims[0]} x {dims[1]} x {dims[2]}")


def _digits(number: int | float, scalar_type: str) -> str:
    if scalar_type != "float32" or math.isnan(number):
        return repr(number).removesuffix(".0")
    told = [text for digits in SINGLE_DIGITS if _is_same(float(text := f"{number:.{digits}g}"), number)]
    return min(told, key=len)  # fewer digits and a power of ten may be longer


def _is_same(told: float, number: float) -> bool:
    """As float32."""
    return struct.pack("<f", told) == struct.pack("<f", number)
