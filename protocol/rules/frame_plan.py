"""A frame's numbers: the client plans each frame once, servers check that they can compute with it, and obey.

All that decides the image of given voxel packets is here and in the shading rule. Whatever machines draw it have it
from one place, so that they need not compute alike to agree.
"""

import itertools
import math
from enum import StrEnum
from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT, Order, Scene
from volsplat.protocol.description.volume import LONGEST_AXIS, Box, Geometry, Index
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.footprint_shape import FootprintShape, footprint_shape
from volsplat.protocol.rules.grid_on_screen import (
    FIXED_ONE,
    LARGEST_POSITION,
    Dda,
    GridOnScreen,
    grid_on_screen,
    layer_distances,
)
from volsplat.protocol.rules.level_gain import footprint_gain
from volsplat.protocol.rules.levels import Resolution, bounds_at_level, dims_at_level, own_resolution
from volsplat.protocol.rules.packet_layout import BLOCK_ROWS
from volsplat.protocol.rules.refinement import STEP_RULES
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_order, screen_rotation
from volsplat.protocol.rules.rounding import DOWN, TO_NEAREST, Thresholds, thresholds_of
from volsplat.protocol.rules.slab_shape import SlabShape, slab_shape
from volsplat.protocol.rules.traversal import (
    EVERY_LAYER_ALIKE,
    AxisVisits,
    Traversal,
    mean_stride,
    traversal_of,
    visits_of,
)
from volsplat.protocol.rules.volume_edges import MOST_EDGES, Edge, volume_edges

CELLS_IN_A_SHEET = 3  # that a ray passes through, each for as much of its path
BLOCK_CLASSES = 27

MOST_ROWS = 2**32 - 1  # of a frame of slabs: they are counted in 32 bits

FARTHEST_VALUE = (LARGEST_POSITION + 1) * FIXED_ONE  # of a DDA: half steps are rounded


class Reach(StrEnum):
    """How a sample reaches the pixels (design, section 6)."""

    FOOTPRINT = "footprint"  # weights from the footprint table
    CELL = "cell"  # the pixel centres inside its cell in its sheet, where rays enter, cross and leave the sheet
    PIXEL = "pixel"  # the one nearest pixel: voxels are no larger than a pixel
    SLABS = "slabs"  # slices of its kernel, on planes parallel to the screen (see slab_shape)


class FramePlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What servers need to know of a frame, in indices of the level drawn.

    It is always level: where runs of samples would go up or down the image rather than across, x and y are exchanged,
    and the image is turned back when it is published. So the pixels around a run lie in few rows.
    """

    step: Step
    turned: bool  # x and y are exchanged: the image's width is `height`
    width: int  # pixels
    height: int
    order: Order  # never FASTEST
    frozen_alpha: float  # front to back: from here on a pixel no longer changes
    factors: Index  # voxels of the volume that one of the level stands for along i, j, k
    x: Dda  # pixels from the centre of the top-left pixel, to the right, or down if turned
    y: Dda  # likewise, down, or to the right
    screen_index: tuple[Dda, Dda, Dda]  # fields screen x, y (up), z: the byte is value >> 32, clamped to 0..255
    traversal: Traversal
    visits: tuple[AxisVisits, AxisVisits, AxisVisits]  # for i, j, k
    reach: Reach
    footprint: FootprintShape | None  # where that is how samples reach the pixels
    slabs: SlabShape | None  # likewise
    # See opacity_exponent; for blocks that are the first, between or the last on each axis, i fastest
    opacity_exponents: Annotated[tuple[float, ...], Meta(min_length=BLOCK_CLASSES, max_length=BLOCK_CLASSES)]
    edges: Annotated[tuple[Edge, ...], Meta(max_length=MOST_EDGES)]  # on the published image, never exchanged

    def __post_init__(self) -> None:
        for name, extent in (("width", self.width), ("height", self.height)):
            if not 1 <= extent <= LARGEST_EXTENT:
                raise ValueError(f"{name} must be 1 to {LARGEST_EXTENT} pixels, not {extent}")
        if self.order == Order.FASTEST:
            raise ValueError("a frame is drawn in one of the two orders, not in the fastest")
        if not 0 < self.frozen_alpha <= FROZEN_ALPHA:
            raise ValueError(f"pixels are frozen from an alpha above 0 to {FROZEN_ALPHA} on, not {self.frozen_alpha}")
        if not all(1 <= factor <= LONGEST_AXIS for factor in self.factors):
            raise ValueError(f"a level's factors must be 1 to {LONGEST_AXIS}, not {self.factors}")
        high = self.bounds.high
        if max(dda.greatest(high) for dda in (self.x, self.y, *self.screen_index)) > FARTHEST_VALUE:
            raise ValueError(f"the grid reaches further than {LARGEST_POSITION} pixels from the image")
        if (self.footprint is None) == (self.reach == Reach.FOOTPRINT):
            raise ValueError(f"samples reach the pixels by a footprint, or have none; their reach is {self.reach}")
        if (self.slabs is None) == (self.reach == Reach.SLABS):
            raise ValueError(f"samples reach slabs, or there are none; their reach is {self.reach}")
        if self.slabs is not None:
            self._check_slabs(self.slabs)
        if not all(0 <= exponent < math.inf for exponent in set(self.opacity_exponents)):
            raise ValueError(f"opacity exponents must be finite and not below 0, not {self.opacity_exponents}")

    def _check_slabs(self, slabs: SlabShape) -> None:
        if self.turned or self.order != Order.FRONT_TO_BACK or max(self.strides) > 1:
            raise ValueError("slabs are drawn front to back, of every voxel, and never turned")
        if self.frozen_alpha < FROZEN_ALPHA:
            raise ValueError("slabs are drawn until nothing can be seen behind them")
        if slabs.depth.greatest(self.bounds.high) > FARTHEST_VALUE:
            raise ValueError(f"the grid reaches further than {LARGEST_POSITION} planes from the first one")
        if self.keys[1] > MOST_ROWS:
            raise ValueError(f"slabs can be drawn of {MOST_ROWS} rows of voxels at most, not of {self.keys[1]}")

    @property
    def counts(self) -> Index:
        """How many sheets, rows and samples are visited."""
        sheet, row, sample = (self.visits[axis].count for axis in self.traversal.axes)
        return (sheet, row, sample)

    @property
    def hides(self) -> bool:
        """Whether samples are left out that reach closed tiles only (see closed_tiles)."""
        return self.order == Order.FRONT_TO_BACK and self.reach != Reach.PIXEL

    @property
    def keys(self) -> Index:
        """Below what the sheet, row and sample of a row run lie (see packet_layout)."""
        sheet, row, sample = self.counts
        if self.slabs is None:
            return (sheet, row, sample)
        return (self.slabs.groups, sheet * -(-row // BLOCK_ROWS) * BLOCK_ROWS, sample)

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the published image, in pixels."""
        return (self.height, self.width) if self.turned else (self.width, self.height)

    @property
    def upright(self) -> "FramePlan":
        """The same frame with x to the right and y down, whichever way its runs go."""
        return self._exchanged() if self.turned else self

    @property
    def thresholds(self) -> Thresholds:
        """By which its sheets round positions."""
        if self.reach != Reach.FOOTPRINT:
            return DOWN if self.reach == Reach.PIXEL else TO_NEAREST
        visits, ascending = self.visits[self.traversal.axes[0]], self.traversal.ascending[0]
        first = visits.index(0 if ascending else visits.count - 1)
        return thresholds_of(first, visits.stride if ascending else -visits.stride)

    @property
    def strides(self) -> Index:
        """Every how many of the level's voxels are visited along i, j and k."""
        return _strides(self.visits)

    @property
    def stride(self) -> float:
        """That on all axes alike by which as many would be visited."""
        return mean_stride(self.strides)

    @property
    def bounds(self) -> Box:
        """The part of the level's grid that is drawn."""
        (i0, i1), (j0, j1), (k0, k1) = ((visits.low, visits.high) for visits in self.visits)
        return Box((i0, j0, k0), (i1, j1, k1))

    def _exchanged(self) -> "FramePlan":
        return msgspec.structs.replace(
            self,
            turned=not self.turned,
            width=self.height,
            height=self.width,
            x=self.y,
            y=self.x,
            footprint=None if self.footprint is None else self.footprint.mirrored(),
        )


def plan_frame(scene: Scene, geometry: Geometry, step: Step, resolution: Resolution | None = None) -> FramePlan:
    """Derive a frame's numbers. Raises ValueError where bounds or view do not fit the volume.

    `geometry` is the volume's; the frame is drawn from `resolution`, or where there is none from the volume, strided.
    """
    drawn = resolution or own_resolution(geometry, step)
    try:
        grid = grid_on_screen(scene, geometry, drawn.geometry)
        return _planned(scene, geometry, step, drawn, grid)
    except (OverflowError, ZeroDivisionError) as error:
        raise ValueError("the volume's place in space and the view are beyond what float64 can compute with") from error


def _planned(scene: Scene, geometry: Geometry, step: Step, drawn: Resolution, grid: GridOnScreen) -> FramePlan:
    in_volume = resolved_bounds(scene, geometry)
    bounds = bounds_at_level(in_volume, grid.factors)
    if STEP_RULES[step].slabs:
        return _planned_slabs(scene, geometry, step, grid, bounds)
    order = resolved_order(scene, geometry)
    distances = layer_distances(drawn.geometry) if STEP_RULES[step].footprint else EVERY_LAYER_ALIKE
    traversal = traversal_of(grid.ray_to_viewer(), order, distances)
    strides = traversal.on_axes(drawn.strides)
    i, j, k = (visits_of(bounds.low[axis], bounds.high[axis], strides[axis]) for axis in range(3))
    sample, (across, down, _) = traversal.axes[2], grid.pixels_per_index
    reach = Reach.FOOTPRINT if STEP_RULES[step].footprint else _nearest_reach(grid, strides, scene)
    footprint, gain = _footprint(scene, geometry, grid, strides) if reach == Reach.FOOTPRINT else (None, 1.0)
    x, y = (_at_samples(dda, (i, j, k)) if reach == Reach.FOOTPRINT else dda for dda in (grid.x, grid.y))
    plan = FramePlan(
        step=step,
        turned=False,
        width=scene.image.width,
        height=scene.image.height,
        order=order,
        frozen_alpha=drawn.frozen_alpha,
        factors=grid.factors,
        x=x,
        y=y,
        screen_index=grid.screen_index(geometry),
        traversal=traversal,
        visits=(i, j, k),
        reach=reach,
        footprint=footprint,
        slabs=None,
        opacity_exponents=_opacity_exponents(grid, reach, traversal, (i, j, k), in_volume, gain),
        edges=volume_edges(scene, geometry),
    )
    return plan._exchanged() if abs(down[sample]) > abs(across[sample]) else plan


def _planned_slabs(scene: Scene, geometry: Geometry, step: Step, grid: GridOnScreen, bounds: Box) -> FramePlan:
    """Voxels are visited beyond the bounds too, as far as it takes to reconstruct what is within."""
    rotation = screen_rotation(scene.view)
    slabs = slab_shape(grid, geometry, rotation, scene.reconstruction, bounds)
    dims = dims_at_level(geometry.dims, grid.factors)
    i, j, k = (
        visits_of(max(low - more, 0), min(high + more, size), 1)
        for low, high, more, size in zip(*bounds, slabs.beyond, dims, strict=True)
    )
    return FramePlan(
        step=step,
        turned=False,
        width=scene.image.width,
        height=scene.image.height,
        order=Order.FRONT_TO_BACK,
        frozen_alpha=FROZEN_ALPHA,
        factors=grid.factors,
        x=grid.x,
        y=grid.y,
        screen_index=grid.screen_index(geometry),
        traversal=traversal_of(grid.ray_to_viewer(), Order.FRONT_TO_BACK),
        visits=(i, j, k),
        reach=Reach.SLABS,
        footprint=None,
        slabs=slabs,
        opacity_exponents=(1.0,) * BLOCK_CLASSES,
        edges=volume_edges(scene, geometry),
    )


def _at_samples(dda: Dda, visits: tuple[AxisVisits, AxisVisits, AxisVisits]) -> Dda:
    """Where samples themselves lie, but for outermost ones whose blocks the bounds cut, by up to half their stride.

    Those of even strides lie half a voxel beyond the middles of their blocks.
    """
    beyond = sum(step * _beyond_middle(one) for step, one in zip(dda.half_steps, visits, strict=True))
    return msgspec.structs.replace(dda, origin=dda.origin + beyond)


def _beyond_middle(visits: AxisVisits) -> int:
    """How far samples lie beyond the middles of their blocks, in half voxels, as the one in the middle does."""
    middle = visits.count // 2
    return 2 * visits.index(middle) + 1 - sum(visits.block(middle))


def _footprint(scene: Scene, geometry: Geometry, grid: GridOnScreen, strides: Index) -> tuple[FootprintShape, float]:
    """The footprint of a frame, and how much more opaque it is for being a coarser level's."""
    shape = footprint_shape(grid, strides, scene.reconstruction)
    if grid.factors == (1, 1, 1):
        return shape, 1.0
    own = footprint_shape(grid_on_screen(scene, geometry), strides, scene.reconstruction)
    gain = footprint_gain(shape.amplitude, own.amplitude, grid.thickness)
    return msgspec.structs.replace(shape, amplitude=shape.amplitude * gain), gain


def opacity_exponent(
    grid: GridOnScreen, reach: Reach, axes: Index, stride: float, block: Index, gain: float = 1.0
) -> float:
    """The t of 1 - (1 - a)^t for a sample whose clipped block has this many voxels along i, j, k.

    `axes` are those of sheet, row and sample, `stride` is their mean. a is the opacity of one of the volume's
    reference spacings; a coarser level's is thicker. Footprints carry thickness in their weights, so there only the
    stride counts, and what their weights are multiplied by. Cells cover a pixel three times in each sheet, so t is a
    third of the path through the sheet in reference spacings; one pixel holds many cells, so there it is the path times
    the cell's share of the pixel.
    """
    if reach == Reach.FOOTPRINT:
        return grid.thickness * stride / gain
    if reach == Reach.PIXEL:
        return grid.thickness * (grid.zoom * grid.zoom * (block[0] * block[1] * block[2]))
    return grid.thickness * (grid.path_through(*axes) * block[axes[0]] / CELLS_IN_A_SHEET)


def _opacity_exponents(
    grid: GridOnScreen,
    reach: Reach,
    traversal: Traversal,
    visits: tuple[AxisVisits, AxisVisits, AxisVisits],
    bounds: Box,
    gain: float,
) -> tuple[float, ...]:
    """Of blocks that reach beyond the volume, or its bounds, as much less as is missing; `bounds` are the volume's."""
    axes, stride = traversal.axes, mean_stride(_strides(visits))
    on_axes = [
        list(zip(on_axis.block_sizes(), _shares(on_axis, factor, low, high), strict=True))
        for on_axis, factor, low, high in zip(visits, grid.factors, *bounds, strict=True)
    ]
    exponents = []
    for (k, share_k), (j, share_j), (i, share_i) in itertools.product(*reversed(on_axes)):
        there = share_i * share_j * share_k
        exponents.append(opacity_exponent(grid, reach, axes, stride, (i, j, k), gain) * there)
    return tuple(exponents)


def _strides(visits: tuple[AxisVisits, AxisVisits, AxisVisits]) -> Index:
    i, j, k = (on_axis.stride for on_axis in visits)
    return (i, j, k)


def _shares(visits: AxisVisits, factor: int, low: int, high: int) -> tuple[float, float, float]:
    """How much of the first block, those between, and the last one lies within low..high of the volume."""
    first, last = (
        (min(end * factor, high) - max(begin * factor, low)) / ((end - begin) * factor)
        for begin, end in (visits.block(0), visits.block(visits.count - 1))
    )
    return (first, 1.0, last)


def _nearest_reach(grid: GridOnScreen, strides: Index, scene: Scene) -> Reach:
    """PIXEL where the outline of a voxel's block fits into a pixel, so that no pixel is left out; else CELL.

    Whatever closed shell of voxels a pixel's rays pass through, then one of its samples lies in the pixel. But pixels
    have more or fewer of them than their share; cells are of every pixel's own ray, and take twice as long.
    """
    if scene.reconstruction.precise:
        return Reach.CELL
    spans = [
        sum(stride * abs(step) for stride, step in zip(strides, grid.pixels_per_index[axis], strict=True))
        for axis in range(2)
    ]
    return Reach.PIXEL if max(spans) <= 1.0 else Reach.CELL
