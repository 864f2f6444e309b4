"""How bright a level is against the level before, by what is seen in its columns, and what makes up for that.

Along a column (held/level_columns.py) the light is summed that the level's voxels send to the viewer, and that of the
voxels that they stand for. What a level emits, and the light that falls on it, are multiplied by how these sums compare
from where the viewer is: layers seen edge on gain more by a coarser level than those seen from above. Each level is
compared with the one before, so the factors of levels multiply.

No colour exceeds 1, and a bright voxel's is cut off there, which happens less to a level's means. How much light it
takes until then differs from channel to channel, and how much there is from frame to frame. So the light is taken in
steps, of each of which a voxel reflects as much as it has room for.

A layer lets exp(-depth) through: the depth that it has by footprints of a pixel a voxel on the level, of half a pixel
on the one before (see level_gain).
"""

import math
from bisect import bisect_left
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.level_columns import LevelColumns, Looks, Reflected, Seen, Slant
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.level_gain import LEAST_PEAK, dilogarithm, footprint_gain

ROUNDED_TO = 1024  # so that processors that sum otherwise agree
LEAST_FACTOR, GREATEST_FACTOR = 0.5, 2.0
LEAST_SHARE = 1.0 - 1e-9  # of what is to be reflected: where all colours are white, more light changes nothing
DILOGARITHMS = 1024  # places at which it is known, with straight lines between
KEPT_DIRECTIONS = 24  # of 1 MiB, of all levels and tables; a view takes three of a level
LIGHT_STEPS, LIGHT_STEP = 4, 0.5  # there is no more light than of them all

Numbers = NDArray[np.float64]
Light = NDArray[np.float64]  # (32768,)
Colours = NDArray[np.float64]  # (65536, 3)


def depths(opacity: Numbers, thickness: float, amplitude: float) -> Numbers:
    """Optical depth of a layer, as thick as a voxel, of voxels of this opacity, which is that of a volume's voxel.

    Theirs are `thickness` times as thick, and have footprints of this amplitude.
    """
    gain = footprint_gain(amplitude, amplitude / thickness**2, thickness)
    own = 1.0 - (1.0 - np.minimum(opacity, 1.0)) ** (thickness / gain)
    places = np.arange(DILOGARITHMS + 1) / DILOGARITHMS
    weighted = np.minimum(gain * amplitude * own / LEAST_PEAK, 1.0)
    of_weighted: Numbers = np.interp(weighted, places, _dilogarithms()) * LEAST_PEAK / amplitude
    return of_weighted


@lru_cache(1)
def _dilogarithms() -> Numbers:
    return np.array([dilogarithm(n / DILOGARITHMS) for n in range(DILOGARITHMS + 1)])


def reflected_in_steps(refl: Colours, room: Colours) -> Numbers:
    """What voxels reflect of each step of the light, the means of three channels: (65536, 4).

    All together they reflect min(refl * light, room), if the light or what takes a channel's room is so many whole
    steps, and nearly so between.
    """
    of_channels, room_of_channels = np.ascontiguousarray(refl), np.ascontiguousarray(room)
    return np.asarray(_kernels.reflected_in_steps(of_channels.data, room_of_channels.data, LIGHT_STEP))


class Look(NamedTuple):
    """What tables make of a level's voxels, at density | strength << 8, colours as means of three."""

    opacity: Numbers  # (65536,)
    emitted: Numbers  # (65536,)
    reflected: Numbers  # (65536, 4), see reflected_in_steps

    def in_layers(self) -> Looks:
        """Of a depth that is still to be set."""
        looks = np.zeros((len(self.opacity), 2 + LIGHT_STEPS))
        looks[:, 1], looks[:, 2:] = self.emitted, self.reflected
        return looks


class SeenLevel:
    """A level and the level before, from all sides, as some tables show them."""

    def __init__(self, columns: LevelColumns, finer: Look, coarser: Look) -> None:
        self._columns = columns
        self._layers = [
            depths(look.opacity, thickness, (thickness / columns.thickness[-1]) ** 2)
            for look, thickness in zip((finer, coarser), columns.thickness, strict=True)
        ]
        self._looks = (finer, coarser)

    def emission(self, eye: Vector | None) -> float:
        """What multiplies what the level emits to `eye`, which is towards the viewer, along i, j, k; with None on the
        mean over all sides.

        From both ends of each column: whether layers are seen edge on is the same from both, and chance is halved.
        """
        seen = [
            [side.share * emitted for emitted in end.emitted]
            for side in self._columns.sides(eye)
            for end in _from_ends(self, side.number, side.slant)
        ]
        of_finer, of_coarser = zip(*seen, strict=True)
        return factor(math.fsum(of_finer), math.fsum(of_coarser))

    def light(self, eye: Vector, finer: Light, coarser: Light) -> float:
        """What multiplies the light on the level; `finer` is that on the level before, by direction codes of its own.

        `eye` is as above.
        """
        sides = [
            (side.share, _from_ends(self, side.number, side.slant)[side.from_high]) for side in self._columns.sides(eye)
        ]
        of_finer, of_coarser = (
            _reflected([(share, seen.reflected[which]) for share, seen in sides], light)
            for which, light in enumerate((finer, coarser))
        )
        return _factor_to_reflect(of_coarser, of_finer.amount(1.0))

    def from_ends(self, number: int, slant: Slant) -> tuple[Seen, Seen]:
        """Along the columns of a direction, from their lower and their upper end."""
        tables = [look.in_layers() for look in self._looks]
        lengths = self._columns.lengths(number)
        for table, layer, length in zip(tables, self._layers, lengths, strict=True):
            table[:, 0] = layer * length
        finer, coarser = tables
        return self._columns.seen(number, slant, finer, coarser)


@lru_cache(KEPT_DIRECTIONS)
def _from_ends(level: SeenLevel, number: int, slant: Slant) -> tuple[Seen, Seen]:
    return level.from_ends(number, slant)


def _reflected(sides: Iterable[tuple[float, Reflected]], light: Light) -> _kernels.ReflectedLight:
    """`sides` are their shares, and what is seen from them."""
    reflected = _kernels.ReflectedLight(light.data, LIGHT_STEP)
    for share, seen in sides:
        reflected.add(share, seen.codes.data, seen.by_step.data)
    return reflected


def _factor_to_reflect(coarser: _kernels.ReflectedLight, amount: float) -> float:
    """What multiplies the light so that as much is reflected; 1 where there is nothing."""
    if amount <= 0.0 or coarser.amount(1.0) <= 0.0:
        return 1.0
    tried = range(round(LEAST_FACTOR * ROUNDED_TO), round(GREATEST_FACTOR * ROUNDED_TO) + 1)
    below = bisect_left(tried, amount * LEAST_SHARE, key=lambda n: coarser.amount((n - 0.5) / ROUNDED_TO))
    return tried[max(below - 1, 0)] / ROUNDED_TO


def factor(finer: float, coarser: float) -> float:
    """What the coarser sum is to be multiplied by; 1 where there is nothing."""
    if finer <= 0.0 or coarser <= 0.0:
        return 1.0
    rounded = math.floor(finer / coarser * ROUNDED_TO + 0.5) / ROUNDED_TO
    return min(max(rounded, LEAST_FACTOR), GREATEST_FACTOR)


def eye_along_axes(light: Vector, half_way: Vector, geometry: Geometry) -> Vector:
    """Towards the viewer, along the unit vectors of i, j, k. `light` and `half_way` are those of the frame."""
    twice = 2.0 * matrices.dot(light, half_way)
    eye = (
        twice * half_way[0] - light[0],
        twice * half_way[1] - light[1],
        twice * half_way[2] - light[2],
    )
    i, j, k = (
        matrices.dot(matrices.normalised(matrices.column(geometry.index_to_physical, axis)), eye) for axis in range(3)
    )
    return (i, j, k)
