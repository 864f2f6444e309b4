"""The place of a seismic survey in its own frame: x to growing crossline numbers, z up, y to the left of x on the map.

The map is turned but never mirrored, so inlines may grow towards -y. Two-way time becomes depth by one velocity.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.protocol.description.volume import Geometry, GridAxis, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector

DEFAULT_VELOCITY = 2000.0  # m/s; then a millisecond, there and back, is a metre
METRES_PER_FOOT = 0.3048
LENGTHS = (0, 1)  # codes of coordinates' units; others are angles on the globe
RIGHT_ANGLE = 1e-3  # cosine of the angle between lines, below which rounded coordinates mean a right one
OFF_THE_GRID = 0.5  # of the distance of lines, by which coordinates may lie beside an even grid
TURNED_DEGREES = 0.1
CUBES: Matrix = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0))


class Spot(NamedTuple):
    """Where one trace lies: its grid position, and its coordinates to the east and north."""

    crossline: int
    inline: int
    east: float
    north: float


class Vertical(NamedTuple):
    """The samples: the first and their distance, in ms or in the unit of length; `velocity` in m/s if one is given."""

    first: float
    step: float
    in_depth: bool
    velocity: float | None


class Placed(NamedTuple):
    """What is known of a survey's place."""

    geometry: Geometry
    unit: str
    axis: GridAxis  # of the samples
    warnings: tuple[str, ...]


def placed(path: Path, dims: Index, spots: Sequence[Spot], units: int, vertical: Vertical, in_feet: bool) -> Placed:
    """The place of the grid. Without usable coordinates its voxels become cubes, for nothing states their shape."""
    unit = "ft" if in_feet else "m"
    axis = GridAxis("depth" if vertical.in_depth else "time", "ms", vertical.first, vertical.step)
    if vertical.in_depth:
        axis = GridAxis("depth", unit, vertical.first, vertical.step)
    steps = _map_steps(spots) if units in LENGTHS else None
    if steps is None:
        angles = spots and units not in LENGTHS
        why = "its coordinates are angles on the globe" if angles else "it has no usable coordinates"
        unused = ", whatever the velocity" if vertical.velocity else ""
        note = f"{why}: the distances of traces are unknown, voxels are drawn as cubes{unused}"
        return Placed(checked_geometry(path, dims, CUBES), "", axis, (note,))
    notes = []
    down = vertical.step
    if not vertical.in_depth:
        velocity = vertical.velocity or DEFAULT_VELOCITY
        down = vertical.step / 1000 * velocity / 2 / (METRES_PER_FOOT if in_feet else 1.0)
        notes.append(
            f"time is drawn as depth by a velocity of {velocity:g} m/s, {velocity / 2000:g} m for each ms of two-way "
            f"time; choose another as in {path}#velocity=3000"
        )
    along, across, azimuth = steps
    if abs(azimuth - 90.0) > TURNED_DEGREES:
        notes.append(
            "drawn in the survey's own frame: x runs to growing crossline numbers, "
            f"towards azimuth {azimuth:.1f} degrees on the map"
        )
    columns: tuple[Vector, Vector, Vector] = ((0.0, 0.0, -down), along, across)
    top = -vertical.first * down / vertical.step
    return Placed(checked_geometry(path, dims, matrices.transposed(columns), (0.0, 0.0, top)), unit, axis, tuple(notes))


def _map_steps(spots: Sequence[Spot]) -> tuple[Vector, Vector, float] | None:
    """One crossline on and one inline on in the survey's frame, and the azimuth of its x axis; None without a grid."""
    fits = [_plane(spots, [spot.east for spot in spots]), _plane(spots, [spot.north for spot in spots])]
    if None in fits:
        return None
    (east_j, east_k, east_error), (north_j, north_k, north_error) = (fit or (0.0, 0.0, 0.0) for fit in fits)
    along = math.sqrt(east_j * east_j + north_j * north_j)
    across = math.sqrt(east_k * east_k + north_k * north_k)
    if not max(east_error, north_error) < OFF_THE_GRID * min(along, across):
        return None
    forward = (east_j * east_k + north_j * north_k) / along
    sideways = (east_j * north_k - north_j * east_k) / along
    if abs(forward) < RIGHT_ANGLE * across:
        forward, sideways = 0.0, math.copysign(across, sideways)
    azimuth = math.degrees(math.atan2(east_j, north_j)) % 360.0
    return (along, 0.0, 0.0), (forward, sideways, 0.0), azimuth


def _plane(spots: Sequence[Spot], values: Sequence[float]) -> tuple[float, float, float] | None:
    """The plane of least squares through values at grid positions: its slopes and greatest error.

    By exactly rounded sums, so that each machine has the same bits.
    """
    count = len(spots)
    if not count:
        return None
    mean_j, mean_k = (math.fsum(spot[n] for spot in spots) / count for n in range(2))
    mean = math.fsum(values) / count
    rows = [(spot[0] - mean_j, spot[1] - mean_k, value - mean) for spot, value in zip(spots, values, strict=True)]
    jj, jk, kk = (math.fsum(row[a] * row[b] for row in rows) for a, b in ((0, 0), (0, 1), (1, 1)))
    jv, kv = (math.fsum(row[a] * row[2] for row in rows) for a in range(2))
    determinant = jj * kk - jk * jk
    if determinant <= 0.0:
        return None
    slope_j, slope_k = (jv * kk - kv * jk) / determinant, (kv * jj - jv * jk) / determinant
    return slope_j, slope_k, max(abs(v - slope_j * j - slope_k * k) for j, k, v in rows)
