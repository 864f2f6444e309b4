"""A frame's numbers, derived from scene, geometry, step and resolution by one rule for all programs.

Screen positions here are in pixels from the centre of the top-left pixel, x to the right and y *down*; depth z
points to the viewer. The DDA is 64-bit fixed point: 2^-32 pixel, stepped by *half* voxels, from the grid's origin,
so that a sample's position never depends on where its sub-cube, row or batch starts.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

from volsplat.protocol.description.scene import Order, Scene, Step, View
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.geometry.upright import upright
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.levels import (
    Resolution,
    bounds_at_level,
    factors_of,
    own_resolution,
    point_at_level,
    thickness_of,
)
from volsplat.protocol.rules.refinement import STEP_RULES
from volsplat.protocol.rules.traversal import AxisVisits, Traversal, traversal_of, visits_of

FRACTION_BITS = 32
FIXED_ONE = 1 << FRACTION_BITS
LARGEST_POSITION = 1 << 29  # pixels; beyond it 64 bits would not hold the DDA

CELLS_IN_A_SHEET = 3  # that a ray passes through, each for as much of its path

FIT_FRACTION = 0.98  # of the image's shorter side, for the ball that a fit shows: without a volume's data all of it


class Reach(StrEnum):
    """How a sample reaches the pixels (design, section 6)."""

    FOOTPRINT = "footprint"  # weights from the footprint table
    CELL = "cell"  # the pixel centres inside its cell in its sheet, where rays enter, cross and leave the sheet
    PIXEL = "pixel"  # the one nearest pixel: voxels are no larger than a pixel


@dataclass(frozen=True)
class Dda:
    """An affine map of the grid in fixed point: value(i, j, k) = origin + sum of twice the index times half step."""

    origin: int
    half_steps: Index  # for half a step along i, j, k

    def at_half_indices(self, doubled: Index) -> int:
        """The value at the grid point whose doubled indices are given (blocks are centred on half voxels)."""
        h = self.half_steps
        return self.origin + doubled[0] * h[0] + doubled[1] * h[1] + doubled[2] * h[2]


@dataclass(frozen=True)
class FramePlan:
    """What both servers and the reference need to know of a frame, in indices and spacings of the level drawn."""

    step: Step
    width: int
    height: int
    zoom: float  # pixels per reference spacing
    factors: Index  # voxels of the volume that one of the level stands for along i, j, k
    thickness: float  # reference spacing, in those of the volume
    stride: int
    rotation: Matrix  # physical to screen axes (x right, y up, z to the viewer)
    pixels_per_index: Matrix  # grid step to pixels, rows x right, y DOWN, z to the viewer
    x: Dda
    y: Dda
    depth: Dda  # z in pixels: only its signs, magnitudes and order matter
    screen_index: tuple[Dda, Dda, Dda]  # fields screen x, y (up), z: the byte is value >> 32, clamped to 0..255
    order: Order  # never FASTEST
    traversal: Traversal
    visits: tuple[AxisVisits, AxisVisits, AxisVisits]  # for i, j, k
    bounds: Box
    reach: Reach

    def opacity_exponent(self, block: Index) -> float:
        """The t of 1 - (1 - a)^t for a sample whose clipped block has this many voxels along i, j, k.

        a is the opacity of one of the volume's reference spacings; a coarser level's is thicker.
        Footprints carry thickness in their weights, so there only the stride counts. Cells cover a pixel three times
        in each sheet, so t is a third of the path through the sheet in reference spacings; one pixel holds many
        cells, so there it is the path times the cell's share of the pixel.
        """
        return self.thickness * self._reference_spacings(block)

    def _reference_spacings(self, block: Index) -> float:
        if self.reach == Reach.FOOTPRINT:
            return float(self.stride)
        if self.reach == Reach.PIXEL:
            return self.zoom * self.zoom * (block[0] * block[1] * block[2])
        sheet, row, sample = self.traversal.axes
        area = abs(_cross2(self.pixels_per_index, row, sample))
        path = abs(matrices.determinant(self.pixels_per_index)) / (area * self.zoom) * block[sheet]
        return path / CELLS_IN_A_SHEET


def plan_frame(scene: Scene, geometry: Geometry, step: Step, resolution: Resolution | None = None) -> FramePlan:
    """Derive a frame's numbers. Raises ValueError where bounds or view do not fit the volume.

    `geometry` is the volume's; the frame is drawn from `resolution`, or where there is none from the volume, strided.
    """
    drawn = resolution or own_resolution(geometry, step)
    level = drawn.geometry
    factors, thickness = factors_of(geometry, level), thickness_of(geometry, level)
    bounds = bounds_at_level(resolved_bounds(scene, geometry), factors)
    rotation = screen_rotation(scene.view)
    zoom = resolved_zoom(scene, geometry) * thickness
    scale = zoom / level.reference_spacing
    in_pixels = matrices.times(matrices.product(rotation, level.index_to_physical), scale)
    to_pixels: Matrix = (in_pixels[0], matrices.scaled(in_pixels[1], -1.0), in_pixels[2])
    center = point_at_level(resolved_center(scene, geometry), factors)
    middle = ((scene.image.width - 1) / 2, (scene.image.height - 1) / 2, 0.0)
    origin = matrices.minus(middle, matrices.applied(to_pixels, center))
    _check_reach(origin, to_pixels, level.dims)
    x, y, depth = (_dda(origin[axis], to_pixels[axis]) for axis in range(3))
    rule = STEP_RULES[step]
    visits = tuple(visits_of(bounds.low[axis], bounds.high[axis], drawn.stride) for axis in range(3))
    order = resolved_order(scene, geometry)
    traversal = traversal_of(_ray_to_viewer(to_pixels, zoom), order)
    reach = Reach.FOOTPRINT if rule.footprint else _nearest_reach(to_pixels, drawn.stride)
    return FramePlan(
        step=step,
        width=scene.image.width,
        height=scene.image.height,
        zoom=zoom,
        factors=factors,
        thickness=thickness,
        stride=drawn.stride,
        rotation=rotation,
        pixels_per_index=to_pixels,
        x=x,
        y=y,
        depth=depth,
        screen_index=_screen_index_ddas(in_pixels, geometry, factors),
        order=order,
        traversal=traversal,
        visits=(visits[0], visits[1], visits[2]),
        bounds=bounds,
        reach=reach,
    )


def screen_rotation(view: View) -> Matrix:
    """The rotation from physical to screen axes."""
    return matrices.product(matrices.rotation_from_quaternion(view.rotation), upright(view.up))


def resolved_bounds(scene: Scene, geometry: Geometry) -> Box:
    """The scene's bounds with -1 replaced. Raises ValueError naming the axis where they leave the volume."""
    low = scene.bounds.low
    high = tuple(n if h == -1 else h for h, n in zip(scene.bounds.high, geometry.dims, strict=True))
    for axis, name in enumerate("ijk"):
        if not 0 <= low[axis] < high[axis] <= geometry.dims[axis]:
            raise ValueError(
                f"bounds on {name} are {low[axis]}..{high[axis]}, but the volume has {name} from 0 to "
                f"{geometry.dims[axis]}; give low < high within that range"
            )
    return Box(low, (high[0], high[1], high[2]))


def resolved_center(scene: Scene, geometry: Geometry) -> Vector:
    if scene.view.center != "middle":
        return scene.view.center
    ni, nj, nk = geometry.dims
    return ((ni - 1) / 2, (nj - 1) / 2, (nk - 1) / 2)


def resolved_zoom(scene: Scene, geometry: Geometry) -> float:
    """Pixels per reference spacing; "fit" puts the volume's bounding sphere inside the image."""
    if scene.view.zoom != "fit":
        return scene.view.zoom
    diameter = 2 * bounding_radius(geometry) / geometry.reference_spacing
    return FIT_FRACTION * min(scene.image.width, scene.image.height) / diameter


def resolved_order(scene: Scene, geometry: Geometry) -> Order:
    """Back-to-front or front-to-back, for all steps alike; the faster one where the scene leaves it open.

    Front to back what is hidden is skipped, but each sample costs a little more: it is slower where the whole
    volume at the tables' greatest opacity would still hide nothing.
    """
    if scene.order != Order.FASTEST:
        return scene.order
    greatest = scene.tables.opac.greatest
    if scene.shading.modulation:
        greatest *= scene.tables.modu.greatest
    thickest = 2 * bounding_radius(geometry) / geometry.reference_spacing
    hides = greatest >= 1.0 or -math.log1p(-greatest) * thickest >= -math.log(1.0 - FROZEN_ALPHA)
    return Order.FRONT_TO_BACK if hides else Order.BACK_TO_FRONT


def bounding_radius(geometry: Geometry) -> float:
    """The radius of the sphere around the middle of the volume that holds all its cells, in physical units."""
    ni, nj, nk = geometry.dims
    m = geometry.index_to_physical
    corners = [matrices.applied(m, (ni / 2, sj * nj / 2, sk * nk / 2)) for sj in (-1.0, 1.0) for sk in (-1.0, 1.0)]
    return max(matrices.length(corner) for corner in corners)


def _ray_to_viewer(to_pixels: Matrix, zoom: float) -> Index:
    """What a ray adds to i, j and k over one reference spacing of depth, in fixed point, so that ties are ties."""
    ray = matrices.scaled(matrices.column(matrices.inverse(to_pixels), 2), zoom * FIXED_ONE)
    return (math.floor(ray[0] + 0.5), math.floor(ray[1] + 0.5), math.floor(ray[2] + 0.5))


def _dda(origin: float, steps: Vector) -> Dda:
    half = matrices.scaled(steps, FIXED_ONE / 2)
    return Dda(
        origin=math.floor(origin * FIXED_ONE + 0.5),
        half_steps=(math.floor(half[0] + 0.5), math.floor(half[1] + 0.5), math.floor(half[2] + 0.5)),
    )


def _screen_index_ddas(in_pixels: Matrix, geometry: Geometry, factors: Index) -> tuple[Dda, Dda, Dda]:
    """The fields screen x, y, z over the volume's bounding sphere, as values whose integer part is the byte.

    `in_pixels` is the level's grid step, y up.
    """
    ni, nj, nk = geometry.dims
    middle = point_at_level(((ni - 1) / 2, (nj - 1) / 2, (nk - 1) / 2), factors)
    step_length = matrices.length(matrices.column(in_pixels, 0)) / matrices.length(
        matrices.column(geometry.index_to_physical, 0)
    )
    radius = bounding_radius(geometry) * step_length / factors[0]
    per_pixel = 256 / (2 * radius)
    x, y, z = (
        _dda(128 - matrices.dot(in_pixels[axis], middle) * per_pixel, matrices.scaled(in_pixels[axis], per_pixel))
        for axis in range(3)
    )
    return (x, y, z)


def _check_reach(origin: Vector, to_pixels: Matrix, dims: Index) -> None:
    for axis in range(2):
        far = abs(origin[axis]) + sum(abs(to_pixels[axis][a]) * dims[a] for a in range(3))
        if not far <= LARGEST_POSITION:  # nor NaN
            raise ValueError(
                f"the volume reaches {far:.0f} pixels from the image, more than {LARGEST_POSITION}; lower the zoom "
                "or move the centre"
            )


def _nearest_reach(to_pixels: Matrix, stride: int) -> Reach:
    """PIXEL where the outline of a voxel's block fits into a pixel, so that no pixel is left out; else CELL.

    Whatever closed shell of voxels a pixel's rays pass through, then one of its samples lies in the pixel.
    """
    spans = [stride * sum(map(abs, to_pixels[axis])) for axis in range(2)]
    return Reach.PIXEL if max(spans) <= 1.0 else Reach.CELL


def _cross2(m: Matrix, a: int, b: int) -> float:
    """The signed area on the screen of the parallelogram of two grid axes, in square pixels."""
    return m[0][a] * m[1][b] - m[0][b] * m[1][a]
