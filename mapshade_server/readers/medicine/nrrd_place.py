"""Where an NRRD file says that its voxels lie (teem.sourceforge.net/nrrd/format.html, sections 5 and 8).

Either each axis has a direction in a named space, or only positions or a spacing along itself. Physical axes become
LPS if the space is a patient's. Else they stay what the file has, but for left-handed spaces: the picture is drawn
in a right-handed one, so one axis is turned round, lest the picture be a mirror image.

`measurement frame` and `thicknesses` describe the values, not of where these lie.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from volsplat.mapshade_server.readers.medicine.nrrd_header import NrrdHeader
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix, Vector, scaled, transposed
from volsplat.protocol.text.length_units import CommonUnit, in_one_unit, told_several

DISAGREEMENT = 0.01  # of a spacing, that the one by an axis' ends may differ from the stated one


class Space(NamedTuple):
    """`signs` turn its axes into left, posterior, superior, or else into a right-handed space."""

    signs: Vector
    anatomical: bool = False


# By the letters and digits of their names; each is also there with time as a last axis.
_SPACES = {
    Space((-1.0, -1.0, 1.0), True): "rightanteriorsuperior ras",
    Space((1.0, -1.0, 1.0), True): "leftanteriorsuperior las",
    Space((1.0, 1.0, 1.0), True): "leftposteriorsuperior lps",
    Space((1.0, 1.0, 1.0)): "scannerxyz 3drighthanded",
    Space((1.0, -1.0, 1.0)): "3dlefthanded",
}
SPACES = {
    name + time: space for space, names in _SPACES.items() for name in names.split() for time in ("", "time", "t")
}
UNNAMED = Space((1.0, 1.0, 1.0))


class NrrdPlace(NamedTuple):
    """Of the three axes of one volume: i, j and k."""

    geometry: Geometry
    unit: str
    anatomical: bool
    warnings: tuple[str, ...]


class _Lengths(NamedTuple):
    """Along i, j and k of a volume whose axes have no directions."""

    steps: Vector
    starts: Vector  # of the first voxels' centres
    warnings: tuple[str, ...]


def place_of(header: NrrdHeader, axes: tuple[int, int, int], dims: Index) -> NrrdPlace:
    """The place of the volume whose i, j and k are the header's `axes`. Raises BadInput if there is none."""
    space = _space(header)
    if "space directions" not in header.fields:
        return _by_lengths(header, axes, dims, space)
    directions = header.vectors("space directions")
    fitting = len(directions) == len(header.integers("sizes"))
    steps = [direction for axis in axes if fitting and (direction := directions[axis]) is not None]
    if len(steps) != 3:
        raise header.wrong("space directions", "does not give a vector for each axis of the volume")
    (unit, factors), told = _units(header, header.quoted("space units"), (0, 1, 2))
    turn = [sign * factor for sign, factor in zip((space or UNNAMED).signs, factors, strict=True)]
    rows = transposed((steps[0], steps[1], steps[2]))
    matrix: Matrix = (scaled(rows[0], turn[0]), scaled(rows[1], turn[1]), scaled(rows[2], turn[2]))
    origin = [sign * x for sign, x in zip(turn, _origin(header) or (0.0, 0.0, 0.0), strict=True)]
    anatomical = space is not None and space.anatomical
    if space is not None and math.prod(space.signs) < 0 and not anatomical:
        told += (f"the space {header.fields['space']} is drawn with y turned round, which keeps left and right",)
    geometry = checked_geometry(header.path, dims, matrix, tuple(origin))
    return NrrdPlace(geometry, unit or ("mm" if anatomical else ""), anatomical, told)  # as all writers of these mean


def _space(header: NrrdHeader) -> Space | None:
    """The space that is named, None if none is. Raises BadInput if it is none that the format has."""
    if "space" not in header.fields:
        return None
    space = SPACES.get(re.sub(r"[-\s]", "", header.fields["space"].lower()))
    if space is None:
        raise header.wrong("space", "is no space of NRRD's, so that left and right cannot be told")
    return space


def _origin(header: NrrdHeader) -> Vector | None:
    if "space origin" not in header.fields:
        return None
    origins = header.vectors("space origin")
    if len(origins) != 1 or origins[0] is None:
        raise header.wrong("space origin", "is not one vector")
    return origins[0]


def _by_lengths(header: NrrdHeader, axes: tuple[int, int, int], dims: Index, space: Space | None) -> NrrdPlace:
    """The place of axes without directions: they are taken to lie along x, y and z."""
    lengths = _lengths(header, axes, dims)
    (unit, factors), told = _units(header, header.quoted("units") or header.quoted("space units"), axes)
    steps = [step * factor for step, factor in zip(lengths.steps, factors, strict=True)]
    starts = [start * factor for start, factor in zip(_origin(header) or lengths.starts, factors, strict=True)]
    rows = tuple(scaled(row, step) for row, step in zip(IDENTITY, steps, strict=True))
    if space is not None:
        stated = f"the header names the space {header.fields['space']} but gives no directions in it"
        told += (f"{stated}: left and right cannot be told",)
    geometry = checked_geometry(header.path, dims, rows, tuple(starts))
    return NrrdPlace(geometry, unit, False, (*lengths.warnings, *told))


def _lengths(header: NrrdHeader, axes: tuple[int, int, int], dims: Index) -> _Lengths:
    """Step and start of each axis by spacings, axis mins and axis maxs, which say nothing if they are NaN."""
    spacings, mins, maxs = (_of_axes(header, name, axes) for name in ("spacings", "axis mins", "axis maxs"))
    nodes = [center == "node" for center in _centers(header, axes)]
    steps, starts, unknown, told = [], [], [], []
    for axis, (size, step, low, high, node) in enumerate(zip(dims, spacings, mins, maxs, nodes, strict=True)):
        steps_within = max(size - 1, 1) if node else size  # mins and maxs are the outer faces of cells
        by_ends = (high - low) / steps_within
        if math.isnan(step):
            step = by_ends
        elif math.isfinite(by_ends) and abs(by_ends - step) > DISAGREEMENT * abs(step):
            told.append(f"axis mins and maxs of {'ijk'[axis]} are {by_ends:.4g} a voxel; its spacing {step:g} is used")
        if math.isnan(step):
            unknown.append("ijk"[axis])
            step = 1.0
        if math.isnan(low):
            low = high - steps_within * step
        start = low if node else low + step / 2
        steps.append(step)
        starts.append(0.0 if math.isnan(start) else start)
    if 0 < len(unknown) < 3:
        told.append(f"the header states no spacing of {' and '.join(unknown)}: taken as 1")
    return _Lengths((steps[0], steps[1], steps[2]), (starts[0], starts[1], starts[2]), tuple(told))


def _of_axes(header: NrrdHeader, name: str, axes: tuple[int, int, int]) -> list[float]:
    """The field's numbers for these axes, NaN if it is not there."""
    if name not in header.fields:
        return [math.nan] * 3
    given = header.numbers(name, len(header.integers("sizes")))
    return [given[axis] for axis in axes]


def _centers(header: NrrdHeader, axes: tuple[int, int, int]) -> list[str]:
    words = header.fields.get("centers", "").lower().split()
    return [words[axis] if axis < len(words) else "" for axis in axes]


def _units(header: NrrdHeader, named: Sequence[str], axes: tuple[int, int, int]) -> tuple[CommonUnit, tuple[str, ...]]:
    """What makes lengths along these axes ones in a single unit, and a warning about them."""
    names = [named[axis] for axis in axes] if len(named) > max(axes) else list(named[:1]) * 3
    if common := in_one_unit(names or [""] * 3):
        return common, ()
    return CommonUnit.none(), (told_several(names),)
