"""Where the voxels of a FITS cube lie, by its world coordinates (WCS), which astropy interprets.

The sky is seen as astronomers draw it: x to the west, so that right ascension grows to the left, z to the north, and
y away from the observer. The third axis has no length on the sky. It is drawn as long as the mean of the two sky axes,
receding away from the observer: growing velocity or wavelength, falling frequency. A galaxy so keeps its handedness
whatever its spectral axis counts.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.protocol.description.volume import Geometry, GridAxis, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector

STEPS_OF_DIFFERENCE = 2.0  # voxels, to either side of the middle
STEP_DECIMALS = 6  # of a voxel: what may differ between machines' sines lies far below
MOST_TILT = 0.1  # tangent, of a sky axis that still counts as right ascension or declination
ARCMINUTES_FROM = 10.0  # extent of the sky above which it is measured in arcminutes
FLAT_SKY = 600.0  # arcminutes, above which a flat sky is reported
UNEVEN = 0.5  # channels, by which the middle of a spectral axis may lie beside its even steps
MICROMETRES_FROM = 1e-6  # metres of wavelength

ARCMINUTES_PER_DEGREE = 60.0
ARCSECONDS_PER_ARCMINUTE = 60.0

# Units that a third axis is shown in, and whether it grows away from the observer.
_THIRD_AXES = (
    ("velocity", "km/s", True),
    ("frequency", "GHz", False),
    ("energy", "keV", False),
    ("wavenumber", "1/cm", False),
)
_SKY_NAMES = {"RA": "RA", "DEC": "Dec"}

# Without world coordinates: i to the right and j up, as images are shown, and right-handed.
_AS_SHOWN: Matrix = ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


class Placed(NamedTuple):
    """What is known of a cube's place."""

    geometry: Geometry
    unit: str
    axes: tuple[GridAxis, GridAxis, GridAxis] | None
    warnings: tuple[str, ...]
    spectral: str = ""  # the CTYPE of the third axis, if the others lie on the sky and it is of a spectrum


def placed(path: Path, header: Any, hdus: Any, dims: Index, axes: Index, picked: Mapping[int, int]) -> Placed:
    """The place of the cube of the array's `axes`, numbered from 0 as in NAXIS1 = 0; `picked` are indices on others.

    Raises BadInput if its steps span no space.
    """
    try:
        wcs = library("astropy.wcs", "FITS").WCS(header, fobj=hdus)
        cube = _Cube(wcs, dims, axes, picked)
        cube.world(cube.middle)
    except (ValueError, TypeError, KeyError, IndexError) as error:
        reason = " ".join(str(error).split()).rstrip(".")[:120]
        note = f"its world coordinates cannot be used ({reason}): voxels are drawn as cubes"
        return Placed(_centred(path, dims, _AS_SHOWN), "", None, (note,))
    if cube.has_sky:
        return _on_the_sky(path, cube)
    if cube.common_length:
        return _in_space(path, cube)
    note = "its header gives the axes no common unit of length: voxels are drawn as cubes"
    return Placed(_centred(path, dims, _AS_SHOWN), "", cube.plain_axes() if cube.is_named else None, (note,))


@dataclass(frozen=True)
class _Cube:
    """Three axes of an array and its WCS."""

    wcs: Any
    dims: Index
    axes: Index
    picked: Mapping[int, int]

    @property
    def middle(self) -> Vector:
        return ((self.dims[0] - 1) / 2, (self.dims[1] - 1) / 2, (self.dims[2] - 1) / 2)

    def world(self, index: Sequence[float]) -> list[float]:
        """The world coordinates of a grid point, all of them."""
        pixel = [float(self.picked.get(axis, 0)) for axis in range(self.wcs.naxis)]
        for axis, position in zip(self.axes, index, strict=True):
            pixel[axis] = position
        return [float(value) for value in self.wcs.wcs_pix2world([pixel], 0)[0]]

    def step(self, axis: int, world_axis: int) -> float:
        """How fast a world coordinate grows along the grid's `axis` in the middle of the cube."""
        difference = self._between(axis, -STEPS_OF_DIFFERENCE, STEPS_OF_DIFFERENCE)[world_axis]
        if world_axis == self.wcs.wcs.lng:
            difference = (difference + 180.0) % 360.0 - 180.0
        return difference / (2 * STEPS_OF_DIFFERENCE)

    def _between(self, axis: int, low: float, high: float) -> list[float]:
        ends = []
        for shift in (low, high):
            index = list(self.middle)
            index[axis] += shift
            ends.append(self.world(index))
        return [after - before for before, after in zip(*ends, strict=True)]

    @cached_property
    def has_sky(self) -> bool:
        return {self.wcs.wcs.lng, self.wcs.wcs.lat} <= set(self.axes)

    @property
    def third(self) -> int:
        """Which grid axis does not lie on the sky."""
        return next(n for n, axis in enumerate(self.axes) if axis not in (self.wcs.wcs.lng, self.wcs.wcs.lat))

    @property
    def is_named(self) -> bool:
        return any(self.name(axis) for axis in self.axes)

    def name(self, axis: int) -> str:
        return str(self.wcs.wcs.ctype[axis]).strip()

    def unit(self, axis: int) -> Any:
        return self.wcs.wcs.cunit[axis]

    @cached_property
    def common_length(self) -> str:
        """The unit of the first axis, if all three are lengths in space; "" otherwise."""
        units = [self.unit(axis) for axis in self.axes]
        in_space = self.wcs.wcs.spec not in self.axes and all(unit.is_equivalent("m") for unit in units)
        return str(units[0]) if in_space else ""

    def plain_axes(self) -> tuple[GridAxis, GridAxis, GridAxis]:
        return _plain_axis(self, 0), _plain_axis(self, 1), _plain_axis(self, 2)


def _on_the_sky(path: Path, cube: _Cube) -> Placed:
    """Two axes on the sky, in arcseconds or arcminutes, and the third stretched to fit."""
    latitude = cube.world(cube.middle)[cube.wcs.wcs.lat]
    to_east = math.cos(math.radians(latitude))
    columns: list[Vector] = []
    for axis in range(3):
        east = cube.step(axis, cube.wcs.wcs.lng) * to_east * ARCMINUTES_PER_DEGREE
        north = cube.step(axis, cube.wcs.wcs.lat) * ARCMINUTES_PER_DEGREE
        columns.append((-east, 0.0, north))
    sky = [n for n in range(3) if n != cube.third]
    extent = sum(matrices.length(columns[n]) * cube.dims[n] for n in sky) / 2
    unit = "arcmin" if extent >= ARCMINUTES_FROM else "arcsec"
    factor = 1.0 if unit == "arcmin" else ARCSECONDS_PER_ARCMINUTE
    third, recedes = _third_axis(cube)
    depth = extent / cube.dims[cube.third] * (1.0 if recedes == (third.step >= 0) else -1.0)
    columns[cube.third] = matrices.plus(columns[cube.third], (0.0, depth, 0.0))
    size = matrices.length(columns[sky[0]]) * factor
    matrix = matrices.transposed(
        tuple(_steady(matrices.scaled(column, factor), size) for column in columns)  # type: ignore[arg-type]
    )
    warnings = [
        f"{third.name} has no length on the sky: its axis is drawn as long as the mean of the two sky axes, "
        f"{extent * factor:.4g} {unit}",
        *_uneven(cube, third),
    ]
    if extent > FLAT_SKY:
        warnings.append("the sky is drawn flat, true to scale in the middle of the cube alone")
    told = [third if n == cube.third else _sky_axis(cube, n, columns[n], factor, unit) for n in range(3)]
    return Placed(
        _centred(path, cube.dims, matrix), unit, (told[0], told[1], told[2]), tuple(warnings), _spectral(cube)
    )


def _in_space(path: Path, cube: _Cube) -> Placed:
    """Three lengths, as simulations have them: world coordinates are physical ones."""
    units = [cube.unit(axis) for axis in cube.axes]
    rows = [
        [cube.step(n, axis) * float(unit.to(units[0])) for n in range(3)]
        for axis, unit in zip(cube.axes, units, strict=True)
    ]
    first = [value * float(unit.to(units[0])) for value, unit in zip(_world_of_first(cube), units, strict=True)]
    return Placed(checked_geometry(path, cube.dims, rows, first), cube.common_length, cube.plain_axes(), ())


def _centred(path: Path, dims: Index, matrix: Matrix) -> Geometry:
    """The grid with the physical origin in its middle."""
    middle = ((dims[0] - 1) / 2, (dims[1] - 1) / 2, (dims[2] - 1) / 2)
    return checked_geometry(path, dims, matrix, matrices.scaled(matrices.applied(matrix, middle), -1.0))


def _steady(column: Vector, size: float) -> Vector:
    """The column rounded to a small share of `size`, so that each machine has the same bits."""
    if not size > 0 or not all(math.isfinite(part) for part in column):
        return column
    unit = float(f"{size:.{STEP_DECIMALS}g}") * 10.0**-STEP_DECIMALS
    return (round(column[0] / unit) * unit, round(column[1] / unit) * unit, round(column[2] / unit) * unit)


def _world_of_first(cube: _Cube) -> list[float]:
    first = cube.world((0.0, 0.0, 0.0))
    return [first[axis] for axis in cube.axes]


def _sky_axis(cube: _Cube, axis: int, column: Vector, factor: float, unit: str) -> GridAxis:
    """Right ascension or declination along the middle row; the distance from the middle if an axis is turned."""
    world_axis = cube.axes[axis]
    is_longitude = world_axis == cube.wcs.wcs.lng
    along, across = (column[0], column[2]) if is_longitude else (column[2], column[0])
    if abs(across) > MOST_TILT * abs(along):
        step = matrices.length(column) * factor
        return GridAxis(f"distance along sky axis {world_axis + 1}", unit, -cube.middle[axis] * step, step)
    label = str(cube.wcs.wcs.lngtyp if is_longitude else cube.wcs.wcs.lattyp).strip()
    step = cube.step(axis, world_axis)
    middle = cube.world(cube.middle)[world_axis]
    first = (middle % 360.0 if is_longitude else middle) - cube.middle[axis] * step
    return GridAxis(_SKY_NAMES.get(label, label), "deg", first, step)


def _spectral(cube: _Cube) -> str:
    """The CTYPE of the axis beside the sky, if that or its unit is of a spectrum."""
    axis = cube.axes[cube.third]
    unit = cube.unit(axis)
    if axis == cube.wcs.wcs.spec or any(unit.is_equivalent(told) for _, told, _ in _THIRD_AXES):
        return cube.name(axis) or str(unit)
    return ""


def _third_axis(cube: _Cube) -> tuple[GridAxis, bool]:
    """What the indices of the axis beside the sky stand for, and whether growing values recede."""
    unit = cube.unit(cube.axes[cube.third])
    for name, told, recedes in _THIRD_AXES:
        if unit.is_equivalent(told):
            return _converted_axis(cube, cube.third, name, told), recedes
    if cube.axes[cube.third] == cube.wcs.wcs.spec and unit.is_equivalent("m"):
        length = abs(cube.world(cube.middle)[cube.wcs.wcs.spec]) * float(unit.to("m"))
        told = "µm" if length >= MICROMETRES_FROM else "Å"
        return _converted_axis(cube, cube.third, "wavelength", told), True
    return _plain_axis(cube, cube.third), True


def _converted_axis(cube: _Cube, axis: int, name: str, told: str) -> GridAxis:
    factor = float(cube.unit(cube.axes[axis]).to({"µm": "um", "Å": "Angstrom"}.get(told, told)))
    first, last = _ends(cube, axis)
    return GridAxis(name, told, first * factor, (last - first) * factor / max(cube.dims[axis] - 1, 1))


def _plain_axis(cube: _Cube, axis: int) -> GridAxis:
    first, last = _ends(cube, axis)
    name = cube.name(cube.axes[axis]) or f"axis {cube.axes[axis] + 1}"
    return GridAxis(name, str(cube.unit(cube.axes[axis])), first, (last - first) / max(cube.dims[axis] - 1, 1))


def _ends(cube: _Cube, axis: int) -> tuple[float, float]:
    """The world coordinate at the first and last index, on the middle of the other axes."""
    low, high = list(cube.middle), list(cube.middle)
    low[axis], high[axis] = 0.0, cube.dims[axis] - 1.0
    return cube.world(low)[cube.axes[axis]], cube.world(high)[cube.axes[axis]]


def _uneven(cube: _Cube, third: GridAxis) -> list[str]:
    """A note if the third axis is not evenly stepped."""
    world_axis = cube.axes[cube.third]
    first, last = _ends(cube, cube.third)
    beside = abs(cube.world(cube.middle)[world_axis] - (first + last) / 2)
    if beside * max(cube.dims[cube.third] - 1, 1) <= UNEVEN * abs(last - first):
        return []
    return [f"{third.name} is not evenly stepped: its channels are drawn at even distances"]
