"""Which voxels around a place a slab can depend on, as sets of offsets in the grid.

They are found from the middle of a slab, with a ball for all that a turn may change. So where voxels are cubes the sets
are the same from every side, and what servers find by them holds while the volume turns.
"""

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple

import msgspec

from volsplat.protocol.description.volume import LONGEST_AXIS, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.grid_on_screen import GridOnScreen

LARGEST_SHAPE = 8  # voxels to either side: beyond it a box must do
MOST_TURNS = 8  # of a search for a plane between a body and a point
CELL = 0.5  # from the middle of a voxel's cell to its sides
ROUNDING = 1e-6  # voxels
WIDENING_STEPS = 64


class Neighbourhood(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All offsets that a box and a shape add up to. Both are the same to either side along every axis."""

    box: Index  # voxels to either side
    shape: tuple[tuple[int, ...], ...]  # by offsets along k and j, from 0 on: how far along i; rising nowhere

    def __post_init__(self) -> None:
        lengths = [len(row) for row in self.shape]
        if not lengths or max(lengths) > LARGEST_SHAPE + 1 or len(lengths) > LARGEST_SHAPE + 1 or min(lengths) < 1:
            raise ValueError(f"the shape of a neighbourhood has 1 to {LARGEST_SHAPE + 1} offsets along k and j")
        if not all(0 <= voxels <= LARGEST_SHAPE for row in self.shape for voxels in row):
            raise ValueError(f"the shape of a neighbourhood reaches 0 to {LARGEST_SHAPE} voxels along i")
        if not all(0 <= voxels <= LONGEST_AXIS for voxels in self.box):
            raise ValueError(f"the box of a neighbourhood reaches 0 to {LONGEST_AXIS} voxels")

    @property
    def reach(self) -> Index:
        """Along i, j, k."""
        i = max(max(row) for row in self.shape)
        j, k = max(len(row) for row in self.shape) - 1, len(self.shape) - 1
        return (self.box[0] + i, self.box[1] + j, self.box[2] + k)


class Surroundings(NamedTuple):
    """Offsets of voxels from that in whose cell the middle of a slab lies."""

    looks: Neighbourhood  # what its two densities can depend on
    inner: Neighbourhood  # of these, all that may have weights above 0
    needs: Neighbourhood  # what its gradient can depend on as well
    beyond: Index  # how far outside of the bounds voxels may be needed for what is drawn within


class Radii(NamedTuple):
    """Of a kernel, in voxels."""

    outer: float
    inner: float  # no weight further away is above 0


class Body(NamedTuple):
    """All sums of a point of a cell, of one of a kernel's ellipsoid, and of one of that in which the kernel may lie."""

    radius: float  # of the kernel, in voxels
    pixels: Matrix  # the ball of a pixel in index space, as n^T pixels n
    widening: float  # of the kernel, pixels squared
    moved: float  # pixels

    def support(self, n: Vector) -> tuple[float, Vector]:
        """How far it goes along `n`, and where it ends there."""
        across = matrices.applied(self.pixels, n)
        squared = max(matrices.dot(n, across), 1e-300)
        kernel = math.sqrt(matrices.dot(n, n) + self.widening * squared)
        cell = (math.copysign(CELL, n[0]), math.copysign(CELL, n[1]), math.copysign(CELL, n[2]))
        end = matrices.plus(cell, matrices.scaled(n, self.radius / kernel))
        more = self.radius * self.widening / kernel + self.moved / math.sqrt(squared)
        end = matrices.plus(end, matrices.scaled(across, more))
        return matrices.dot(n, end), end

    def holds(self, point: Vector) -> bool:
        """False only where a plane lies between them."""
        inside: Vector = (_clamped(point[0]), _clamped(point[1]), _clamped(point[2]))
        for _ in range(MOST_TURNS):
            normal = matrices.minus(point, inside)
            if not any(normal):
                break
            far, end = self.support(normal)
            if matrices.dot(normal, point) > far + ROUNDING * matrices.length(normal):
                return False
            towards = matrices.minus(end, inside)
            square = matrices.dot(towards, towards)
            if square == 0.0:
                break
            inside = matrices.plus(inside, matrices.scaled(towards, min(matrices.dot(normal, towards) / square, 1.0)))
        return True

    def reach(self) -> Vector:
        i, j, k = (self.support(axis)[0] + ROUNDING for axis in matrices.IDENTITY)
        return (i, j, k)


def surroundings(
    grid: GridOnScreen, geometry: Geometry, radii: Radii, spacing: float, baseline: int, rounding: float
) -> Surroundings:
    """Of a kernel with these radii, and planes `spacing` pixels apart; gradients look `baseline` pixels aside, and
    voxels are drawn within `rounding` pixels of where they lie."""
    i, j, k = grid.factors
    to_physical = matrices.product(geometry.index_to_physical, ((i, 0.0, 0.0), (0.0, j, 0.0), (0.0, 0.0, k)))
    per_pixel = grid.zoom / (geometry.reference_spacing * grid.thickness)
    lengths = matrices.product(matrices.transposed(to_physical), to_physical)
    pixels = matrices.inverse(matrices.times(lengths, per_pixel * per_pixel))
    widening = _widening(grid, spacing)
    # Gradients also look at the planes in front of a slab and behind it
    to_plane, aside = spacing / 2, max(math.hypot(spacing / 2, baseline), 1.5 * spacing)
    looks, inner = (Body(radius, pixels, widening, to_plane + rounding) for radius in radii)
    needs = Body(radii.outer, pixels, widening, aside + rounding)
    # The middle of a slab that begins or ends within the bounds lies half a slab outside
    half_slab = [to_plane * math.sqrt(pixels[axis][axis]) for axis in range(3)]
    i, j, k = (math.floor(far + more) for far, more in zip(needs.reach(), half_slab, strict=True))
    return Surroundings(_neighbourhood(looks), _neighbourhood(inner), _neighbourhood(needs), (i, j, k))


def _widening(grid: GridOnScreen, spacing: float) -> float:
    """No less than what kernels are widened by in any direction, pixels squared; in steps, whatever was rounded."""
    to_screen = grid.pixels_per_index
    v = matrices.product(to_screen, matrices.transposed(to_screen))
    middle, apart = (v[0][0] + v[1][1]) / 2, math.hypot((v[0][0] - v[1][1]) / 2, v[0][1])
    most = max(1 - (middle - apart), spacing * spacing - v[2][2], 0.0)
    unit = grid.zoom * grid.zoom / WIDENING_STEPS
    return math.ceil(most / unit - ROUNDING) * unit


@lru_cache(maxsize=16)
def _neighbourhood(body: Body) -> Neighbourhood:
    i, j, k = (math.floor(far) for far in body.reach())
    if max(i, j, k) > LARGEST_SHAPE:
        return Neighbourhood((i, j, k), ((0,),))
    shape: list[list[int]] = []
    # From the outermost on, so that nothing rises outwards, whichever way the body leans
    for offset_k in range(k, -1, -1):
        outer = shape[0] if shape else []
        row: list[int] = []
        for offset_j in range(j, -1, -1):
            least = max([row[0]] if row else [], default=-1)
            least = max(least, outer[offset_j] if offset_j < len(outer) else -1)
            found = next((at for at in range(i, least, -1) if _held(body, at, offset_j, offset_k)), least)
            if found >= 0:
                row.insert(0, found)
        if row:
            shape.insert(0, row)
    return Neighbourhood((0, 0, 0), tuple(map(tuple, shape)))


def _held(body: Body, i: int, j: int, k: int) -> bool:
    """Also if it is on another side."""
    sides: Iterable[tuple[int, int]] = {(side_j, side_k) for side_j in (j, -j) for side_k in (k, -k)}
    return any(body.holds((float(i), float(side_j), float(side_k))) for side_j, side_k in sides)


def _clamped(coordinate: float) -> float:
    return min(max(coordinate, -CELL), CELL)
