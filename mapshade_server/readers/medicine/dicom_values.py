"""What the stored numbers of DICOM frames mean: by a slope and an intercept, or a table; their type and their unit."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.medicine.dicom_pixels import Pixels
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.text.errors import BadInput

FUNCTIONAL_GROUPS = ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence")
AIR = -1024  # HU, the least value that a CT measures
# From narrow to wide; the first that holds all values is taken.
WHOLE_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "int64")
UNITS = {"HU": "HU", "HU_MOD": "HU", "MGML": "mg/ml", "PCT": "%", "OD": "10⁻³ OD", "BQML": "Bq/ml", "GML": "g/ml"}
UNITS |= {"CNTS": "counts", "CPS": "counts/s", "GY": "Gy", "1CM": "1/cm", "CM2ML": "cm²/ml"}


@dataclass(frozen=True)
class Rescale:
    """From stored to meant values: by a line, or by a table from `first` on, whose ends hold beyond it.

    Values below `least` mean nothing.
    """

    slope: float = 1.0
    intercept: float = 0.0
    table: tuple[int, ...] = ()
    first: int = 0
    least: float | None = None

    @property
    def is_whole(self) -> bool:
        """Whether it keeps whole numbers whole."""
        return self.slope.is_integer() and self.intercept.is_integer() and self.least is None

    def of(self, stored: Voxels) -> Voxels:
        """The meant values, NaN where there are none."""
        if self.table:
            table = np.array(self.table)
            return np.asarray(table[np.clip(stored.astype(np.int64) - self.first, 0, len(table) - 1)])
        if self == Rescale():
            return stored
        values = np.asarray(stored.astype(np.float64) * self.slope + self.intercept)
        if self.least is not None:
            values[values < self.least] = np.nan
        return values

    def ends(self, signed: bool, bits: int) -> tuple[float, float]:
        """The least and the greatest meant value that there can be of stored numbers of so many bits."""
        if self.table:
            return float(min(self.table)), float(max(self.table))
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        ends = (low * self.slope + self.intercept, high * self.slope + self.intercept)
        return min(ends), max(ends)


def scalar_type_of(stored: Sequence[tuple[Pixels, Rescale]]) -> str:
    """The type that holds all meant values: whole numbers if the rescales keep them whole."""
    dtypes = {pixels.dtype for pixels, _ in stored}
    if any(dtype.kind == "f" for dtype in dtypes) or not all(rescale.is_whole for _, rescale in stored):
        narrow = max(dtype.itemsize for dtype in dtypes) <= 2 or all(dtype == np.float32 for dtype in dtypes)
        return "float32" if narrow else "float64"
    if all(rescale == Rescale() for _, rescale in stored):
        return np.result_type(*(dtype.newbyteorder("=") for dtype in dtypes)).name
    kinds = {(pixels.dtype.kind == "i", pixels.bits_stored, rescale) for pixels, rescale in stored}
    ends = [end for signed, bits, rescale in kinds for end in rescale.ends(signed, bits)]
    fitting = (name for name in WHOLE_TYPES if np.iinfo(name).min <= min(ends) and max(ends) <= np.iinfo(name).max)
    return next(fitting, "float64")


def rescale_of(path: Path, value: Callable[[str, str], Any], head: Any) -> Rescale:
    if tables := head.get("ModalityLUTSequence"):
        return _table(path, tables[0], head)
    group = "PixelValueTransformationSequence"
    slope, intercept = value(group, "RescaleSlope"), value(group, "RescaleIntercept")
    if slope is None:
        slope = head.get("DoseGridScaling")
    numbers = (1.0 if slope is None else float(slope), 0.0 if intercept is None else float(intercept))
    if not all(math.isfinite(number) for number in numbers) or numbers[0] == 0:
        raise BadInput(f"{path}: its rescale by {slope} and {intercept} makes no sense; export it again")
    return Rescale(*numbers, least=_least(head, *numbers))


def _least(head: Any, slope: float, intercept: float) -> float | None:
    """Half-way between air and the padding around a CT's round field of view, which would spoil the window.

    Lossy packing spreads the padding. In other kinds of images it often is the background's own value.
    """
    stated = [head.get("PixelPaddingValue"), head.get("PixelPaddingRangeLimit")]
    meant = [float(value) * slope + intercept for value in stated if value is not None]
    if head.get("Modality") != "CT" or not meant or max(meant) >= AIR:
        return None
    return (max(meant) + AIR) / 2


def _table(path: Path, item: Any, head: Any) -> Rescale:
    count, first, bits = (int(word) for word in words_of(item.get("LUTDescriptor")))
    count = count or 1 << 16
    data = item.get("LUTData")
    if isinstance(data, bytes):
        kind = np.dtype("u1" if bits <= 8 and len(data) < 2 * count else "u2")
        data = np.frombuffer(data, kind.newbyteorder("<" if head.original_encoding[1] else ">")).tolist()
    table = tuple(int(number) for number in ([data] if isinstance(data, int) else data or ()))
    if len(table) < count:
        raise BadInput(f"{path}: its Modality LUT has {len(table)} of {count} values; export it again")
    signed = head.get("PixelRepresentation") == 1
    return Rescale(table=table[:count], first=first - (1 << 16) if signed and first >= 1 << 15 else first)


def value_unit_of(head: Any, modality: str) -> str:
    """The unit of the values after the rescale, "" if the file states none that is known."""
    groups = [head[name].value for name in FUNCTIONAL_GROUPS if name in head and len(head[name].value)]
    inner = [group[0].get("PixelValueTransformationSequence") for group in groups]
    stated = next((item[0].get("RescaleType") for item in inner if item), head.get("RescaleType"))
    if head.get("ModalityLUTSequence"):
        stated = head.ModalityLUTSequence[0].get("ModalityLUTType")
    for said in (stated, head.get("Units"), head.get("DoseUnits")):
        if said in UNITS:
            return UNITS[said]
    rescaled = "RescaleSlope" in head or any(inner)
    return "HU" if modality == "CT" and rescaled and stated in (None, "") else ""


def words_of(value: Any) -> tuple[str, ...]:
    """A value as words, numbers in their shortest form, () if there is none."""
    if value is None or value == "":
        return ()
    values = [value] if isinstance(value, str | int | float) else list(value)
    return tuple(f"{one:g}" if isinstance(one, float) else str(one) for one in values)
