"""Numbers as arrays store them, and the values that they stand for: packed and missing ones by the CF conventions.

https://cfconventions.org, sections 2.5 (missing data) and 8.1 (packed data), as in NetCDF and in what xarray writes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import SCALAR_TYPES, Voxels
from volsplat.protocol.text.errors import BadInput

Attributes = Mapping[str, Any]  # of an array: texts, numbers, and lists of these
DType = np.dtype[np.generic]


@dataclass(frozen=True)
class ArrayValues:
    """How an array's numbers become a volume's values: missing ones NaN, others stored * scale + offset."""

    stored_type: DType  # native; other than the array's own if an attribute says that its numbers are unsigned
    scalar_type: str
    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[Any, ...] = ()  # stored numbers
    lowest: float = -math.inf  # of what is stored and valid
    highest: float = math.inf

    def of(self, stored: NDArray[Any]) -> Voxels:
        """The values of stored numbers, C-contiguous and in native byte order; in their memory if that can be."""
        if stored.dtype.newbyteorder("=") != self.stored_type:
            stored = stored.view(self.stored_type.newbyteorder(stored.dtype.byteorder))
        values: Voxels = np.asarray(stored, self.scalar_type, order="C")
        if values is stored and (self.scale, self.offset) != (1.0, 0.0):
            values = stored.copy()  # missing numbers are looked for among those that are stored
        if self.scale != 1.0:
            values *= self.scale
        if self.offset != 0.0:
            values += self.offset
        for number in self.missing:
            values[stored == number] = np.nan
        if self.lowest > -math.inf:
            values[stored < self.lowest] = np.nan
        if self.highest < math.inf:
            values[stored > self.highest] = np.nan
        return values


def plain_values(whole: str, dtype: DType) -> ArrayValues:
    """The numbers as they are, in a type that volumes have. Raises BadInput if a voxel is not one number."""
    if dtype.kind == "b":
        return ArrayValues(np.dtype(bool), "uint8")
    if dtype == np.float16:
        return ArrayValues(np.dtype(np.float16), "float32")
    if dtype.name not in SCALAR_TYPES:
        what = f"complex numbers ({dtype.name})" if dtype.kind == "c" else f"voxels of type {dtype.name}"
        if dtype.kind == "f":
            raise BadInput(f"{whole}: has {what}, which is not read; save it as float64, as by astype('float64')")
        if dtype.names:
            what = f"voxels of several fields ({', '.join(dtype.names)})"
        raise BadInput(f"{whole}: has {what}, volsplat needs one real number a voxel; export its magnitude or one part")
    return ArrayValues(dtype.newbyteorder("="), dtype.name)


def cf_values(whole: str, dtype: DType, attributes: Attributes) -> ArrayValues:
    """What CF's attributes make of the numbers. Raises BadInput if these attributes make no sense."""
    plain = plain_values(whole, dtype)
    stored, scalar_type = plain.stored_type, plain.scalar_type
    if stored.kind == "i" and str(attributes.get("_Unsigned", "")).lower() == "true":
        stored = np.dtype(f"u{stored.name}")
        scalar_type = stored.name
    scale, offset = _factor(whole, attributes, "scale_factor", 1.0), _factor(whole, attributes, "add_offset", 0.0)
    if scale == 0.0:
        raise BadInput(f"{whole}: its scale_factor is 0, all values would be the same; correct the attribute")
    missing = _stored_numbers(whole, attributes, stored, "_FillValue", "missing_value")
    lowest, highest = _valid_range(whole, attributes, stored)
    becomes_float = (scale, offset) != (1.0, 0.0) or missing or (lowest, highest) != (-math.inf, math.inf)
    if becomes_float and stored.kind != "f":
        scalar_type = "float32" if stored.itemsize <= 2 else "float64"
    return ArrayValues(stored, scalar_type, scale, offset, missing, lowest, highest)


def text_attribute(attributes: Attributes, key: str) -> str:
    """The attribute's text, "" if it has none."""
    value = attributes.get(key)
    return value.strip() if isinstance(value, str) else ""


def _factor(whole: str, attributes: Attributes, key: str, default: float) -> float:
    (number, *_) = _numbers(whole, attributes, key) or [default]
    if not math.isfinite(number):
        raise BadInput(f"{whole}: its attribute {key} is {number}; correct the attribute")
    return float(number)


def _valid_range(whole: str, attributes: Attributes, stored: DType) -> tuple[float, float]:
    limits = _stored_numbers(whole, attributes, stored, "valid_range")
    if len(limits) == 2:
        return limits[0], limits[1]
    low = _stored_numbers(whole, attributes, stored, "valid_min")
    high = _stored_numbers(whole, attributes, stored, "valid_max")
    return low[0] if low else -math.inf, high[0] if high else math.inf


def _stored_numbers(whole: str, attributes: Attributes, stored: DType, *keys: str) -> tuple[Any, ...]:
    """The attributes' numbers as they would be stored, without those that cannot be; NaN needs no mention."""
    numbers = [number for key in keys for number in _numbers(whole, attributes, key) if not math.isnan(number)]
    if stored.kind == "f":
        return tuple(stored.type(number) for number in numbers)
    bits = 8 * stored.itemsize
    # A negative number in an attribute of unsigned ones is how NetCDF-3 has to write a great one.
    finite = [int(number) for number in numbers if math.isfinite(number)]
    wrapped = [number + (1 << bits) if stored.kind == "u" and number < 0 else number for number in finite]
    low, high = (-1 << (bits - 1), 1 << (bits - 1)) if stored.kind == "i" else (0, 1 << bits)
    return tuple(number for number in wrapped if low <= number < high)


def _numbers(whole: str, attributes: Attributes, key: str) -> list[Any]:
    """The attribute's numbers, none if it is not there."""
    value = attributes.get(key)
    numbers = value if isinstance(value, list) else [] if value is None else [value]
    if not all(isinstance(number, int | float) for number in numbers):
        raise BadInput(f"{whole}: its attribute {key} is no number but “{value}”; correct the attribute")
    return numbers
