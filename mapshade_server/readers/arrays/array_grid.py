"""An array as a volume: which three of its axes are the grid, the indices on the others, and its place in space.

The last of the three is i, as C and numpy store arrays. Axes that the file calls x, y and z, or that `axes=` does,
lie along those physical axes whatever their order; others lie along z, y, x in turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart
from volsplat.mapshade_server.readers.reading.grids import geometry
from volsplat.mapshade_server.readers.reading.parts import PartNeeded, numbered
from volsplat.protocol.description.volume import Box, Geometry, GridAxis, Index
from volsplat.protocol.geometry.upright import Up
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.length_units import in_one_unit, length_unit

LETTERS = "xyz"
OPTIONS = ("axes", "spacing", "unit")  # beside the names of axes
COLOUR_COUNTS = (3, 4)
LEAST_PICTURE = 16  # pixels aside: less is no picture, but a volume made to try something
MOST_COMPONENTS = 4  # an axis without a name, last and not longer, holds components: colours, a vector


@dataclass(frozen=True)
class ArrayAxis:
    """One axis of an array, as its file describes it: index n stands for first + n * step, in `unit`."""

    length: int
    name: str = ""
    unit: str = ""
    first: float = 0.0
    step: float = 1.0
    along: str = ""  # the physical axis, x, y or z; "" if the file does not say
    down: bool = False  # it counts against that axis, as a depth does
    vertical: bool = False  # z is not only its name: it is a height or a depth


class ArrayGrid(NamedTuple):
    """The volume in an array."""

    indices: tuple[int | None, ...]  # on each of the array's axes; None on the three of the grid
    geometry: Geometry
    unit: str
    axes: tuple[GridAxis, GridAxis, GridAxis] | None
    warnings: tuple[str, ...]
    up: Up | None  # if an axis is a height or a depth

    def chunk(self, chunks: Sequence[int] | None, read_through: int = 1) -> Index:
        """How many voxels along i, j, k come together if the array lies in chunks.

        If it does not: rows, or as many as have `read_through` voxels.
        """
        if chunks is None:
            ni, nj, _ = self.geometry.dims
            return (ni, min(-(-read_through // ni), nj), 1)
        along = [size for size, index in zip(chunks, self.indices, strict=True) if index is None]
        k, j, i = (min(size, n) for size, n in zip(along, self.geometry.dims[::-1], strict=True))
        return (i, j, k)

    def selection(self, box: Box) -> tuple[int | slice, ...]:
        """What to index the array with to have the voxels of `box`, as (k, j, i)."""
        ranges = [slice(low, high) for low, high in zip(*box, strict=True)]  # i, then j, then k: popped as k, j, i
        return tuple(ranges.pop() if index is None else index for index in self.indices)


def array_grid(part: ArrayPart, axes: Sequence[ArrayAxis]) -> ArrayGrid:
    """The volume that the person means. Raises BadInput if the array has none or they must choose."""
    named = _named(part, axes)
    indices = _indices(part, named)
    k, j, i = (axis for axis, index in zip(named, indices, strict=True) if index is None)
    grid = _along_physical_axes((i, j, k))
    lengths = _lengths(part, grid)
    up: Up | None = "+z" if any(axis.vertical and axis.along == "z" for axis in grid) else None
    return ArrayGrid(indices, _geometry(part, grid, lengths), lengths.unit, _grid_axes(grid), lengths.warnings, up)


def _named(part: ArrayPart, axes: Sequence[ArrayAxis]) -> list[ArrayAxis]:
    """The axes with the names that the person gives them, one letter each."""
    names = part.options.get("axes")
    if names is None:
        return list(axes)
    if len(names) != len(axes) or len(set(names)) != len(names):
        raise part.wrong("axes", f"needs {len(axes)} different letters, one for each of the axes {_shown(axes)}")
    return [
        replace(axis, name=name, along=name if name in LETTERS else "") for axis, name in zip(axes, names, strict=True)
    ]


def _indices(part: ArrayPart, axes: list[ArrayAxis]) -> tuple[int | None, ...]:
    """The index on each axis, None on three: what the person says, 0 on what is 1 long."""
    indices: list[int | None] = [None] * len(axes)
    for key in part.options:
        if key not in OPTIONS:
            n = _axis_called(part, key, axes)
            indices[n] = index = part.whole_number(key)
            if index is not None and index >= axes[n].length:
                raise part.wrong(key, f"is beyond the axis, whose last index is {axes[n].length - 1}")
    free = [n for n, index in enumerate(indices) if index is None]
    for n in [n for n in free if axes[n].length == 1 and not axes[n].along]:
        if len(free) > 3:
            free.remove(n)
            indices[n] = 0
    if len(free) < 3:
        kind = "a single number" if not axes else "a 1-D list" if len(free) == 1 else "a 2-D image"
        chosen = " after the choice of indices" if len(axes) >= 3 else ""
        raise BadInput(
            f"{part.whole}: {kind}{chosen}, volsplat needs a volume: its axes are {_shown(axes) or 'none'}; "
            "name an array with three axes"
        )
    if len(free) == 3:
        _refuse_colours(part, axes, free)
    if min(axes[n].length for n in free) == 0:
        raise BadInput(f"{part.whole}: holds no voxels, its axes are {_shown(axes)}; fetch or export it again")
    if len(free) > 3:
        raise _choice(part, axes, free)
    return tuple(indices)


def _refuse_colours(part: ArrayPart, axes: list[ArrayAxis], free: list[int]) -> None:
    """Raises BadInput for a picture: two long axes and, without a name and last, one of three or four colours."""
    *sides, last = (axes[n] for n in free)
    if last.name or last.along or last.length not in COLOUR_COUNTS or min(n.length for n in sides) < LEAST_PICTURE:
        return
    letters = "zyx" if len(axes) == 3 else "".join(chr(ord("a") + n) for n in range(len(axes)))
    raise BadInput(
        f"{part.whole}: a 2-D image of {last.length} values a pixel, volsplat needs a volume: its axes are "
        f"{_shown(axes)}; if it is a volume, name them, as in {part.advice(f'axes={letters}')}"
    )


def _axis_called(part: ArrayPart, key: str, axes: list[ArrayAxis]) -> int:
    """The axis that `key` names: by its name or how this begins, or as axis0, axis1, ..."""
    numbered = [n for n in range(len(axes)) if key == f"axis{n}"]
    exact = [n for n, axis in enumerate(axes) if axis.name == key]
    begun = [n for n, axis in enumerate(axes) if axis.name.lower().startswith(key.lower())]
    found = exact or numbered or begun
    if len(found) != 1:
        raise part.wrong(key, f"names no axis; the axes are {_shown(axes)}, other options {', '.join(OPTIONS)}")
    return found[0]


def _choice(part: ArrayPart, axes: list[ArrayAxis], free: list[int]) -> BadInput:
    """Asks for indices on all but three axes: those least likely to be of space."""

    def likely_of_space(n: int) -> int:
        components = not axes[n].name and n == free[-1] and axes[n].length <= MOST_COMPONENTS
        return -1 if components else 1 if axes[n].along else 0

    chosen = sorted(sorted(free, key=likely_of_space)[: len(free) - 3])
    names = [_name(axes, n) for n in chosen]
    line = (
        f"{part.whole}: has axes {_shown(axes)}, volsplat needs three of them; choose an index of "
        f"{' and of '.join(names)}, as in {part.advice(','.join(f'{name}=0' for name in names))}"
    )
    first = numbered(axes[chosen[0]].length, axes[chosen[0]].name or f"index along {names[0]}", names[0])
    return PartNeeded(line, [one._replace(part=part.with_option(one.part)) for one in first])


def _name(axes: Sequence[ArrayAxis], n: int) -> str:
    """What an option can call the axis."""
    return axes[n].name if axes[n].name.isidentifier() else f"axis{n}"


def _shown(axes: Sequence[ArrayAxis]) -> str:
    return ", ".join(f"{_name(axes, n)} ({axis.length} long)" for n, axis in enumerate(axes))


def _along_physical_axes(grid: tuple[ArrayAxis, ArrayAxis, ArrayAxis]) -> tuple[ArrayAxis, ArrayAxis, ArrayAxis]:
    """i, j, k, each along its own physical axis: if the file says, else the first that is left."""
    told = [axis.along for axis in grid if axis.along]
    if len(set(told)) != len(told):
        told, grid = [], (replace(grid[0], along=""), replace(grid[1], along=""), replace(grid[2], along=""))
    left = [letter for letter in LETTERS if letter not in told]
    i, j, k = (axis if axis.along else replace(axis, along=left.pop(0)) for axis in grid)
    return i, j, k


class _Lengths(NamedTuple):
    """Steps and first positions of i, j, k in one unit."""

    steps: tuple[float, ...]
    firsts: tuple[float, ...]
    unit: str
    warnings: tuple[str, ...] = ()


def _geometry(part: ArrayPart, grid: tuple[ArrayAxis, ArrayAxis, ArrayAxis], lengths: _Lengths) -> Geometry:
    rows, origin = np.zeros((3, 3)), np.zeros(3)
    for n, axis in enumerate(grid):
        sign, row = -1.0 if axis.down else 1.0, LETTERS.index(axis.along)
        rows[row, n] = sign * lengths.steps[n]
        origin[row] = sign * lengths.firsts[n]
    try:
        return geometry((grid[0].length, grid[1].length, grid[2].length), rows, origin)
    except ValueError as error:
        advice = part.advice("spacing=1x1x1")
        raise BadInput(f"{part.whole}: its spacing cannot be used: {error}; give it yourself, as in {advice}") from None


def _lengths(part: ArrayPart, grid: tuple[ArrayAxis, ArrayAxis, ArrayAxis]) -> _Lengths:
    unit = part.options.get("unit")
    if (spacing := part.numbers("spacing", 3)) is not None:
        steps = tuple(math.copysign(1.0, axis.step) * spacing[LETTERS.index(axis.along)] for axis in grid)
        return _Lengths(steps, (0.0, 0.0, 0.0), unit or "")
    lengths = _in_one_unit(grid) or _without_unit(grid)
    return lengths if unit is None else lengths._replace(unit=unit)


def _in_one_unit(axes: Sequence[ArrayAxis]) -> _Lengths | None:
    """The axes' lengths in the first one's unit, None if they have none in common."""
    common = in_one_unit([axis.unit for axis in axes])
    if common is None:
        return None
    scaled = [(axis.step * factor, axis.first * factor) for axis, factor in zip(axes, common.factors, strict=True)]
    return _Lengths(tuple(step for step, _ in scaled), tuple(first for _, first in scaled), common.unit)


def _without_unit(grid: tuple[ArrayAxis, ArrayAxis, ArrayAxis]) -> _Lengths:
    """Two axes of one unit keep their steps and the third is drawn like them; without such two, voxels are cubes."""
    steps = [math.copysign(1.0, axis.step) for axis in grid]
    firsts = [0.0, 0.0, 0.0]
    for odd in (2, 0, 1):
        pair = [n for n in range(3) if n != odd]
        if alike := _in_one_unit([grid[n] for n in pair]):
            for n, step, first in zip(pair, alike.steps, alike.firsts, strict=True):
                steps[n], firsts[n] = step, first
            steps[odd] = math.copysign(math.sqrt(abs(alike.steps[0] * alike.steps[1])), grid[odd].step)
            break
    told = ", ".join(f"{axis.name or axis.along} in {axis.unit or 'no unit'}" for axis in grid)
    return _Lengths(
        tuple(steps),
        tuple(firsts),
        "",
        (f"its axes have no unit in common ({told}); drawn with like spacing, which spacing=1x1x1 would set",),
    )


def _grid_axes(grid: tuple[ArrayAxis, ArrayAxis, ArrayAxis]) -> tuple[GridAxis, GridAxis, GridAxis] | None:
    """What the indices stand for, if that is more than a place in space."""
    if all(axis.name in ("", *LETTERS) and (not axis.unit or length_unit(axis.unit)) for axis in grid):
        return None
    i, j, k = (GridAxis(axis.name or axis.along, axis.unit, axis.first, axis.step) for axis in grid)
    return i, j, k
