"""How bright a level is against the level before, by what is seen in its columns, and what makes up for that.

Along a column (held/level_columns.py) the light is summed that the level's voxels send to the viewer, and that of the
voxels that they stand for. What a level emits, and the light that falls on it, are multiplied by how these sums compare
from where the viewer is: layers seen edge on gain more by a coarser level than those seen from above. Each level is
compared with the one before, so the factors of levels multiply.

A layer lets exp(-depth) through: the depth that it has by footprints of a pixel a voxel on the level, of half a pixel
on the one before (see level_gain).
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.held.level_columns import LevelColumns, Seen
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.level_gain import LEAST_PEAK, dilogarithm, footprint_gain

ROUNDED_TO = 1024  # so that processors that sum otherwise agree
LEAST_FACTOR, GREATEST_FACTOR = 0.5, 2.0
DILOGARITHMS = 1024  # places at which it is known, with straight lines between

Numbers = NDArray[np.float64]
Light = NDArray[np.float64]  # (32768,)


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


class Look(NamedTuple):
    """What tables make of a level's voxels, at density | strength << 8: (65536,) each, colours as means of three."""

    opacity: Numbers
    emitted: Numbers
    reflected: Numbers


class SeenLevel:
    """A level and the level before, from their six sides, as some tables show them."""

    def __init__(self, columns: LevelColumns, finer: Look, coarser: Look) -> None:
        self._areas = [columns.area(axis) for axis in range(3)]
        level_thickness = columns.thickness[-1]
        layers = [
            depths(look.opacity, thickness, (thickness / level_thickness) ** 2)
            for look, thickness in zip((finer, coarser), columns.thickness, strict=True)
        ]
        self._sides: dict[tuple[int, bool], Seen] = {}
        for axis in range(3):
            looks = [
                np.stack((layer * level.spacing[axis] / level.reference_spacing, look.emitted, look.reflected), axis=1)
                for layer, look, level in zip(layers, (finer, coarser), columns.levels, strict=True)
            ]
            for from_high in (False, True):
                self._sides[axis, from_high] = columns.seen(axis, from_high, looks[0], looks[1])

    def emission(self, eye: Vector | None) -> float:
        """What multiplies what the level emits to `eye`, which is towards the viewer, along i, j, k; with None on the
        mean over all sides.

        From both ends of each axis: whether layers are seen edge on is the same from both, and chance is halved.
        """
        weights = [1.0 if eye is None else abs(eye[axis]) for axis in range(3)]
        seen = [
            (weights[axis] * self._areas[axis], self._sides[axis, from_high].emitted)
            for axis in range(3)
            for from_high in (False, True)
        ]
        return _compared((area * finer, area * coarser) for area, (finer, coarser) in seen)

    def light(self, eye: Vector, finer: Light, coarser: Light) -> float:
        """What multiplies the light on the level; `finer` is that on the level before, by direction codes of its own.

        `eye` is as above.
        """
        seen = [
            (abs(along) * self._areas[axis], self._sides[axis, along > 0.0].reflected) for axis, along in enumerate(eye)
        ]
        return _compared(
            (area * float((of_finer * finer).sum()), area * float((of_coarser * coarser).sum()))
            for area, (of_finer, of_coarser) in seen
        )


def _compared(sums: Iterable[tuple[float, float]]) -> float:
    """Of what is seen of the finer and of the coarser level from each side."""
    of_finer, of_coarser = zip(*sums, strict=True)
    return factor(math.fsum(of_finer), math.fsum(of_coarser))


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
