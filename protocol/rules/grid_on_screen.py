"""Where a volume's grid lies on the screen: in real numbers, and in the fixed point that decides the image.

Screen positions here are in pixels from the centre of the top-left pixel, x to the right and y *down*; depth z
points to the viewer. The DDA is 64-bit fixed point: 2^-32 pixel, stepped by *half* voxels, from the grid's origin,
so that a sample's position never depends on where its sub-cube, row or batch starts.
"""

import math
from dataclasses import dataclass

import msgspec

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.levels import factors_of, point_at_level, thickness_of
from volsplat.protocol.rules.resolved_view import bounding_radius, resolved_center, resolved_zoom, screen_rotation

FRACTION_BITS = 32
DISTANCE_BITS = 20
FIXED_ONE = 1 << FRACTION_BITS
LARGEST_POSITION = 1 << 29  # pixels; beyond it 64 bits would not hold the DDA


class Dda(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """An affine map of the grid in fixed point: value(i, j, k) = origin + sum of twice the index times half step."""

    origin: int
    half_steps: Index  # for half a step along i, j, k

    def at_half_indices(self, doubled: Index) -> int:
        """The value at the grid point whose doubled indices are given (blocks are centred on half voxels)."""
        h = self.half_steps
        return self.origin + doubled[0] * h[0] + doubled[1] * h[1] + doubled[2] * h[2]

    def greatest(self, high: Index) -> int:
        """No value within the blocks of indices 0..high is further from 0, nor is a part of its sum."""
        i, j, k = self.half_steps
        return abs(self.origin) + 2 * (abs(i) * high[0] + abs(j) * high[1] + abs(k) * high[2])


def dda(origin: float, steps: Vector) -> Dda:
    """The nearest one to a map in real numbers."""
    half = matrices.scaled(steps, FIXED_ONE / 2)
    return Dda(
        origin=math.floor(origin * FIXED_ONE + 0.5),
        half_steps=(math.floor(half[0] + 0.5), math.floor(half[1] + 0.5), math.floor(half[2] + 0.5)),
    )


@dataclass(frozen=True)
class GridOnScreen:
    """The grid of a volume, or of one of its levels, in a scene's view."""

    factors: Index  # voxels of the volume that one of the level stands for along i, j, k
    thickness: float  # the level's reference spacing, in those of the volume
    zoom: float  # pixels per reference spacing of the level
    pixels_per_index: Matrix  # grid step to pixels, rows x right, y DOWN, z to the viewer
    origin: Vector  # pixels: where grid point (0, 0, 0) lies

    @property
    def x(self) -> Dda:
        return dda(self.origin[0], self.pixels_per_index[0])

    @property
    def y(self) -> Dda:
        return dda(self.origin[1], self.pixels_per_index[1])

    def ray_to_viewer(self) -> Index:
        """What a ray adds to i, j and k over one reference spacing of depth, in fixed point, so that ties are ties."""
        ray = matrices.scaled(matrices.column(matrices.inverse(self.pixels_per_index), 2), self.zoom * FIXED_ONE)
        return (math.floor(ray[0] + 0.5), math.floor(ray[1] + 0.5), math.floor(ray[2] + 0.5))

    def path_through(self, sheet: int, row: int, sample: int) -> float:
        """What a ray runs inside one layer of the sheet axis, in the level's reference spacings."""
        to_x, to_y, _ = self.pixels_per_index
        area = abs(to_x[row] * to_y[sample] - to_x[sample] * to_y[row])
        return abs(matrices.determinant(self.pixels_per_index)) / (area * self.zoom)

    def screen_index(self, geometry: Geometry) -> tuple[Dda, Dda, Dda]:
        """The fields screen x, y (up), z over the bounding sphere of the volume: their integer part is the byte."""
        to_x, to_y, to_z = self.pixels_per_index
        steps = (to_x, matrices.scaled(to_y, -1.0), to_z)
        ni, nj, nk = geometry.dims
        middle = point_at_level(((ni - 1) / 2, (nj - 1) / 2, (nk - 1) / 2), self.factors)
        step_length = matrices.length(matrices.column(steps, 0)) / matrices.length(
            matrices.column(geometry.index_to_physical, 0)
        )
        radius = bounding_radius(geometry) * step_length / self.factors[0]
        per_pixel = 256 / (2 * radius)
        x, y, z = (
            dda(128 - matrices.dot(steps[axis], middle) * per_pixel, matrices.scaled(steps[axis], per_pixel))
            for axis in range(3)
        )
        return (x, y, z)


def layer_distances(geometry: Geometry) -> Index:
    """How far the layers of neighbouring i, j and k are apart, in fixed point and reference spacings.

    Times what a ray adds to an index that is the cosine of how far a layer is turned away from the viewer.
    """
    across = matrices.times(matrices.inverse(geometry.index_to_physical), geometry.reference_spacing)
    i, j, k = (math.floor((1 << DISTANCE_BITS) / matrices.length(row) + 0.5) for row in across)
    return (i, j, k)


def grid_on_screen(scene: Scene, geometry: Geometry, level: Geometry | None = None) -> GridOnScreen:
    """`geometry` is the volume's; its level, where one is given, lies there.

    Raises ValueError where that is no level of the volume, or too far out for the fixed point.
    """
    level = level or geometry
    factors, thickness = factors_of(geometry, level), thickness_of(geometry, level)
    zoom = resolved_zoom(scene, geometry) * thickness
    scale = zoom / level.reference_spacing
    in_pixels = matrices.times(matrices.product(screen_rotation(scene.view), level.index_to_physical), scale)
    to_pixels: Matrix = (in_pixels[0], matrices.scaled(in_pixels[1], -1.0), in_pixels[2])
    center = point_at_level(resolved_center(scene, geometry), factors)
    middle = ((scene.image.width - 1) / 2, (scene.image.height - 1) / 2, 0.0)
    origin = matrices.minus(middle, matrices.applied(to_pixels, center))
    _check_reach(origin, to_pixels, level.dims)
    return GridOnScreen(factors, thickness, zoom, to_pixels, origin)


def _check_reach(origin: Vector, to_pixels: Matrix, dims: Index) -> None:
    for axis in range(2):
        far = abs(origin[axis]) + sum(abs(to_pixels[axis][a]) * dims[a] for a in range(3))
        if not far <= LARGEST_POSITION:  # nor NaN
            raise ValueError(
                f"the volume reaches {far:.0f} pixels from the image, more than {LARGEST_POSITION}; lower the zoom "
                "or move the centre"
            )
