"""Coordinate variables of the CF conventions (cfconventions.org, chapters 4 and 5): what indices stand for."""

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.arrays.array_grid import ArrayAxis, ArrayGrid
from volsplat.mapshade_server.readers.arrays.array_values import Attributes, text_attribute
from volsplat.mapshade_server.readers.reading.grids import unevenness

MOST_COORDINATES = 1 << 22  # of an axis, that are read: a small file may promise any number of them

_ALONG = {
    "x": "x lon longitude easting projection_x_coordinate grid_longitude degrees_east",
    "y": "y lat latitude northing projection_y_coordinate grid_latitude degrees_north",
    "z": "z lev level depth height altitude plev air_pressure model_level_number",
}
PHYSICAL_AXES = {word: letter for letter, words in _ALONG.items() for word in words.split()}
_LONGITUDES = "lon longitude grid_longitude degrees_east degree_east degrees_e degree_e degreese degreee".split()
_UP = "height altitude".split()
_DOWN = "depth air_pressure".split()
_PRESSURES = "pa hpa kpa dbar decibar decibars mbar millibar millibars bar bars atm".split()


class Coordinates(NamedTuple):
    """One axis by its coordinate variable, and what had to be changed for it to be even, "" for nothing."""

    axis: ArrayAxis
    warning: str = ""


def warnings_of(coordinates: Sequence[Coordinates], grid: ArrayGrid) -> list[str]:
    """What had to be changed of the axes that are drawn."""
    return [one.warning for one, index in zip(coordinates, grid.indices, strict=True) if index is None]


def coordinates_of(
    length: int, name: str, read: Callable[[], NDArray[Any]] | None, attributes: Attributes
) -> Coordinates:
    """The axis `name` of an array, whose coordinates are to be `read`; None if the file has only a name for it."""
    down = _points_down(name, attributes)
    vertical = down is not None or text_attribute(attributes, "axis").lower() == "z"
    axis = ArrayAxis(length, name, along=_along(name, attributes), vertical=vertical)
    if read is None:
        return Coordinates(axis)
    if length > MOST_COORDINATES:
        return Coordinates(axis, f"{name} has more than {MOST_COORDINATES} coordinates; its voxels are drawn one apart")
    numbers = read()
    if numbers.shape != (length,) or numbers.dtype.kind not in "iuf":
        return Coordinates(axis)
    unusable = Coordinates(axis, f"the coordinates of {name} are not usable; its voxels are drawn one apart")
    if not np.isfinite(numbers).all():
        return unusable
    if _is_longitude(name, attributes) and not _goes_one_way(numbers):
        numbers = _counted_on(numbers)
    first, last = float(numbers[0]), float(numbers[-1])
    step = (last - first) / (length - 1) if length > 1 else 1.0
    if not (_goes_one_way(numbers) and step):
        return unusable
    along = axis.along or ("z" if vertical else "")
    placed = ArrayAxis(length, name, _unit(attributes), first, step, along, bool(down), vertical)
    if (uneven := unevenness(numbers)) is None:
        return Coordinates(placed)
    apart = f"{uneven.least:.4g} to {uneven.greatest:.4g}"
    return Coordinates(placed, f"{name} is unevenly spaced ({apart}); drawn {step:.4g} apart")


def _goes_one_way(numbers: NDArray[Any]) -> bool:
    """Whether none falls where others rise."""
    steps = np.diff(numbers.astype(np.float64))
    return bool((steps >= 0).all() or (steps <= 0).all())


def _counted_on(longitudes: NDArray[Any]) -> NDArray[Any]:
    """Beyond 360 or 180 degrees, where they begin anew."""
    kept = longitudes.dtype if longitudes.dtype.kind == "f" else np.float64
    return np.unwrap(longitudes.astype(np.float64), period=360).astype(kept)


def _is_longitude(name: str, attributes: Attributes) -> bool:
    told = (text_attribute(attributes, "standard_name"), text_attribute(attributes, "units"), name)
    return any(word.lower() in _LONGITUDES for word in told)


def _along(name: str, attributes: Attributes) -> str:
    """The physical axis that the variable is along, "" if nothing says so."""
    letter = text_attribute(attributes, "axis").lower()
    if letter in ("x", "y", "z"):
        return letter
    told = (text_attribute(attributes, "standard_name"), text_attribute(attributes, "units"), name)
    return next((PHYSICAL_AXES[word.lower()] for word in told if word.lower() in PHYSICAL_AXES), "")


def _points_down(name: str, attributes: Attributes) -> bool | None:
    """Whether it grows downwards; None if it is neither a height nor a depth nor a pressure, as far as is told.

    A pressure need not say so (chapter 4.3).
    """
    positive = text_attribute(attributes, "positive").lower()
    if positive in ("up", "down"):
        return positive == "down"
    told = {text_attribute(attributes, "standard_name").lower(), name.lower()}
    if text_attribute(attributes, "units").lower() in _PRESSURES or told.intersection(_DOWN):
        return True
    return False if told.intersection(_UP) else None


def _unit(attributes: Attributes) -> str:
    unit = text_attribute(attributes, "units")
    return "deg" if re.fullmatch(r"degrees?(_?(north|south|east|west|[NSEW]))?", unit) else unit
