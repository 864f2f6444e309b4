"""What both kinds of VTK's files make of their grids: images, and rectilinear grids, whose planes may be uneven.

If the places of the planes are even within rounding the voxels are taken as they are. Else they are interpolated
between the two planes on either side, along each axis, and a warning says so. Points and cells that the file hides are
no data.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.components import Component
from volsplat.mapshade_server.readers.reading.grids import checked_geometry, grid_of_cells, unevenness
from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, ReadBox, Voxels
from volsplat.mapshade_server.readers.reading.vtk_ghosts import Ghosts
from volsplat.protocol.description.volume import Box, Geometry, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

EVEN = 1e-3  # of a step: rounding of the number of planes
MOST_GROWTH = 4  # of the planes along an axis

Places = NDArray[np.float64]


@dataclass(frozen=True)
class GridArray:
    """The array of a file that is drawn; `reader` gives what reads it as a grid of so many numbers along i, j, k."""

    name: str
    scalar_type: str
    of_cells: bool
    reader: Callable[[Index], ReadBox]
    why_whole: str
    parts: Sequence[Part]
    component: Component
    ghosts: Ghosts = field(default_factory=Ghosts)

    def reads(self, path: Path, dims: Index) -> tuple[str, ReadBox]:
        """The type of what is drawn, and what reads it."""
        every = self.reader((dims[0] * self.component.count, dims[1], dims[2]))
        read = self.component.of_interleaved(path, self.scalar_type, every)
        return self.ghosts.shown(self.component.scalar_type(self.scalar_type), read, dims, self.of_cells)


def opened_grid(path: Path, array: GridArray, points: Geometry | Sequence[NDArray[Any]]) -> OpenedVolume:
    """The volume of the array on an image's points, or on those at the planes of x, y and z. Raises BadInput."""
    warnings: tuple[str, ...] = ()
    if isinstance(points, Geometry):
        kind, geometry = "image", grid_of_cells(path, points) if array.of_cells else points
        scalar_type, read = array.reads(path, geometry.dims)
    else:
        kind, places = "rectilinear grid", [_middles(one) for one in points] if array.of_cells else points
        i, j, k = (even_axis(path, name, one) for name, one in zip("xyz", places, strict=True))
        scalar_type, stored = array.reads(path, (len(places[0]), len(places[1]), len(places[2])))
        read = EvenGrid((i, j, k), stored).read
        geometry = checked_geometry(
            path, (i.planes, j.planes, k.planes), (i.step, j.step, k.step), (i.first, j.first, k.first)
        )
        warnings = tuple(axis.warning for axis in (i, j, k) if axis.warning)
    description = VolumeDescription(
        name=path.name,
        format=f"VTK {kind}{', values of cells' if array.of_cells else ''}",
        geometry=geometry,
        scalar_type=scalar_type,
        density_name=array.component.value_name(array.name),
        warnings=warnings,
        reads_sub_cubes=not array.why_whole,
        chunk=(geometry.dims[0], 1, 1),
        why_whole=array.why_whole,
    )
    return OpenedVolume(description, read, parts=array.parts)


def _middles(places: NDArray[Any]) -> NDArray[Any]:
    """Where the cells between planes have their middles; of a single plane, on it."""
    return (places[1:] + places[:-1]) / 2 if len(places) > 1 else places


class EvenAxis(NamedTuple):
    """Index n lies at first + n * step; between the planes at[n] of the file, None if these are its own."""

    planes: int
    first: float
    step: float
    at: Places | None = None
    warning: str = ""


def even_axis(path: Path, name: str, stated: NDArray[Any]) -> EvenAxis:
    """The axis for planes at these places, up or down. Raises BadInput unless they go one way."""
    places = stated.astype(np.float64)
    gaps = np.diff(places)
    if not (np.isfinite(places).all() and (bool((gaps > 0).all()) or bool((gaps < 0).all()))):
        raise BadInput(f"{path}: its {name} coordinates do not go one way; correct the file")
    count, first = len(places), float(places[0])
    if count == 1:
        return EvenAxis(1, first, 1.0)
    step = (float(places[-1]) - first) / (count - 1)
    if (uneven := unevenness(stated)) is None:
        return EvenAxis(count, first, step)
    least, greatest = uneven
    finest = max(abs(least), abs(step) * (count - 1) / (MOST_GROWTH * count))
    more = math.ceil(abs(step) * (count - 1) / finest - EVEN) + 1
    finer = step * (count - 1) / (more - 1)
    even = first + finer * np.arange(more)
    at = np.interp(even * math.copysign(1, step), places * math.copysign(1, step), np.arange(count, dtype=np.float64))
    told = f"{name} is unevenly spaced ({abs(least):.4g} to {abs(greatest):.4g}): resampled to {abs(finer):.4g}"
    return EvenAxis(more, first, finer, at, told)


@dataclass(frozen=True)
class EvenGrid:
    """Three even axes along x, y and z; `stored` reads those of the file, whose grid may be uneven."""

    axes: tuple[EvenAxis, EvenAxis, EvenAxis]
    stored: ReadBox

    def read(self, box: Box) -> Voxels:
        """The voxels of a box of the even grid; whole numbers are rounded."""
        if all(axis.at is None for axis in self.axes):
            return self.stored(box)
        parts = [_between(axis, low, high) for axis, low, high in zip(self.axes, *box, strict=True)]
        low = (parts[0].low, parts[1].low, parts[2].low)
        high = (parts[0].high, parts[1].high, parts[2].high)
        stored = self.stored(Box(low, high))
        voxels: Voxels = np.empty(box.size[::-1], stored.dtype)
        along_i, along_j, along_k = parts
        for n in range(box.size[2]):  # sheet by sheet, which bounds what is wide
            sheet = _mixed(stored, along_k.of(n), 0)[0]
            sheet = _mixed(_mixed(sheet, along_j, 0), along_i, 1)
            voxels[n] = sheet if voxels.dtype.kind == "f" else np.rint(sheet)
        return voxels


class _Between(NamedTuple):
    """For each even index the plane below, counted from `low`, and the share of the one above."""

    low: int
    high: int
    below: NDArray[np.int64]
    share: Places

    def of(self, n: int) -> "_Between":
        return self._replace(below=self.below[n : n + 1], share=self.share[n : n + 1])


def _between(axis: EvenAxis, low: int, high: int) -> _Between:
    at = np.arange(low, high, dtype=np.float64) if axis.at is None else axis.at[low:high]
    below = np.floor(at).astype(np.int64)
    share = at - below
    first, last = int(below[0]), int(below[-1] + (share[-1] > 0))
    return _Between(first, last + 1, below - first, share)


def _mixed(values: NDArray[Any], part: _Between, axis: int) -> NDArray[np.float64]:
    """Interpolated along an axis; a plane that has no share is not looked at, since it may be NaN."""
    share = part.share.reshape([-1 if n == axis else 1 for n in range(values.ndim)])
    below = np.take(values, part.below, axis).astype(np.float64)
    above = np.take(values, part.below + (part.share > 0), axis)
    with np.errstate(invalid="ignore"):  # of infinite values
        return np.where(share > 0, below + share * (above - below), below)
