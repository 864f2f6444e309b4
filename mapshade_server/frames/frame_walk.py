"""One frame of a map/shade server: gives the kernel a plan's and a scene's numbers, and hands out its batches."""

import math
from collections.abc import Sequence

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.mapshade_server.links.shaded_batch import ShadedBatch
from volsplat.protocol.description.scene import TABLE_ENTRIES, Field
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import FramePlan, Reach
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, Dda
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.rules.slab_kernels import LEAST_KNOWN
from volsplat.protocol.rules.slab_shape import SlabShape

DEFAULT_PACKETS = 1 << 17  # 1 MiB of all walkers: few hand-overs, and the next stage still finds it in the cache
LEAST_PACKETS = 1 << 16  # of one walker of many: each hand-over takes the interpreter, which they all share
STEP_PACKETS = 1 << 14  # within a process, where handing over costs nothing
DEFAULT_VOXELS = 1 << 22  # some 5 ms where each of them must be looked at, so that an abort is heard soon

SLAB_PACKETS = 1 << 14  # of a batch of unshaded voxels: few of those that follow are then hidden
SLAB_ROUNDING = 1.0  # pixels: by which a voxel may be moved on its way to the planes, at most

NEAREST = 0.5  # pixels: no centre of a pixel is further away than the nearest one

FIELDS = list(Field)  # the kernel knows fields by their place here


class Walker:
    """Walks a part of a server's sub-cubes. One thread at a time may have it walk, by `next_batch` or its source."""

    def __init__(self, kernel: _kernels.Walker, max_packets: int) -> None:
        self.kernel = kernel
        self._max_packets = max_packets
        self._ended = False

    @property
    def source(self) -> object:
        """For kernels that walk without Python: see kernels/batch_source.h. The frame's walk must outlive it."""
        return self.kernel.source

    def next_batch(self, max_packets: float = math.inf, max_voxels: int = DEFAULT_VOXELS) -> ShadedBatch | None:
        """What comes next, or None after the batch that was the last. There is always a last one, if empty.

        The limits decide on which row batches end, not what they hold together; a frame's first batches are smaller.
        The memory of a batch is used again once it and its memoryviews are gone.
        """
        if self._ended:
            return None
        batch = self.kernel.next_batch(int(min(max_packets, self._max_packets)), max_voxels)
        self._ended = batch.last
        return ShadedBatch(batch)


class FrameWalk:
    """Walks a server's packed sub-cubes in visibility order, each of its walkers a part of them."""

    def __init__(
        self,
        sub_cubes: Sequence[SubCube],
        drawing: Drawing,
        closed_tiles: "_kernels.Array | None" = None,
        regions: Sequence[Region] = (),
        walkers: int | None = 1,
    ) -> None:
        """Start at the first sample.

        The sub-cubes are boxes of the level that is drawn.

        `closed_tiles` is the image's map of closed tiles, uint64 shaped `protocol.closed_tiles.tile_map_shape`; it may
        be written meanwhile. What is hidden by it is left out where the plan allows that.

        Of a frame of slabs voxels are handed out unshaded (see packet_layout). Raises ValueError for sub-cubes that are
        too long for it.

        `regions` are those of the plan's lines; without any the image is one. `walkers` take turns, and a batch has a
        part for each region; or, with None, each region has a walker, whose batches have that one part and are small,
        for its owner in the same process.
        """
        closed_tiles, slabs = closed_tiles if drawing.plan.hides else None, drawing.plan.slabs
        if slabs is not None:
            max_packets = SLAB_PACKETS
            walk: _kernels.SlabWalk | _kernels.FrameWalk = _slab_walk(
                sub_cubes, drawing, slabs, closed_tiles, regions, walkers
            )
        else:
            max_packets = max(DEFAULT_PACKETS // walkers, LEAST_PACKETS) if walkers else STEP_PACKETS
            walk = _sheet_walk(sub_cubes, drawing, closed_tiles, regions, walkers, max_packets)
        self.closed_tiles = closed_tiles
        self.walkers = [Walker(walk.walker(number), max_packets) for number in range(walk.walkers)]


def _sheet_walk(
    sub_cubes: Sequence[SubCube],
    drawing: Drawing,
    closed_tiles: "_kernels.Array | None",
    regions: Sequence[Region],
    walkers: int | None,
    max_packets: int,
) -> _kernels.FrameWalk:
    """Sheet by sheet, shaded."""
    plan, shading, geometry, mixture = drawing.plan, drawing.shading, drawing.geometry, mixture_of(sub_cubes)
    cross_bar, rule = shading.cross_bar, shading_tables.opacity_rule(shading, mixture)
    colours = shading_tables.frame_colours(shading, mixture, geometry)
    distinct = sorted(set(plan.opacity_exponents))
    return _kernels.FrameWalk(
        boxes=[(cube.packets, cube.box.low, cube.classified_rows) for cube in sub_cubes],
        axes=plan.traversal.axes,
        ascending=plan.traversal.ascending,
        visits=[(v.low, v.high, v.stride, v.first, v.count) for v in plan.visits],
        x=_numbers(plan.x),
        y=_numbers(plan.y),
        screen_index=[_numbers(dda) for dda in plan.screen_index],
        image=(plan.width, plan.height),
        reach=sample_reach(plan),
        thresholds=plan.thresholds,
        cross_bar=[FIELDS.index(f) for f in (cross_bar.emit, cross_bar.refl, *shading_tables.opacity_fields(rule))],
        emit=colours.emit,
        refl=colours.refl,
        light=shading_tables.frame_light(drawing, mixture),
        opacity=[shading_tables.opacity_codes(rule, exponent) for exponent in distinct],
        opacity_of_class=[distinct.index(exponent) for exponent in plan.opacity_exponents],
        visibility=shading_tables.visibility(rule),
        gradient_bytes=shading_tables.gradient_bytes(drawing.directions, geometry.index_to_physical),
        grid_bytes=[
            shading_tables.grid_bytes(size, factor) for size, factor in zip(geometry.dims, plan.factors, strict=True)
        ],
        closed_tiles=closed_tiles,
        regions=[(region.begin, region.end) for region in regions] or [(0, plan.height)],
        walkers=walkers or 0,
        limits=(max_packets, DEFAULT_VOXELS),
    )


def _slab_walk(
    sub_cubes: Sequence[SubCube],
    drawing: Drawing,
    slabs: SlabShape,
    closed_tiles: "_kernels.Array | None",
    regions: Sequence[Region],
    walkers: int | None,
) -> _kernels.SlabWalk:
    """By groups of planes from the front, unshaded: the voxels that slabs take."""
    plan = drawing.plan
    return _kernels.SlabWalk(
        boxes=[(cube.packets, cube.box.low, cube.needed_voxels) for cube in sub_cubes],
        axes=plan.traversal.axes,
        ascending=plan.traversal.ascending,
        visits=[(v.low, v.high, v.stride, v.first, v.count) for v in plan.visits],
        x=_numbers(plan.x),
        y=_numbers(plan.y),
        depth=_numbers(slabs.depth),
        image=(plan.width, plan.height),
        reach=sample_reach(plan),
        groups=(slabs.groups, slabs.lead, slabs.before),
        dims=drawing.dims,
        visible=shading_tables.visibility(shading_tables.opacity_rule(drawing.shading))[: TABLE_ENTRIES // 8],
        look=(slabs.looks.box, slabs.looks.shape),
        inner=(slabs.inner.box, slabs.inner.shape),
        spread=(slabs.needs.box, slabs.needs.shape),
        overshoot=(slabs.overshoot, slabs.overshoot / LEAST_KNOWN[slabs.kernel]),
        closed_tiles=closed_tiles,
        regions=[(region.begin, region.end) for region in regions] or [(0, plan.height)],
        walkers=walkers or 0,
        limits=(SLAB_PACKETS, DEFAULT_VOXELS),
    )


def sample_reach(plan: FramePlan) -> tuple[float, float]:
    """No sample of a frame reaches pixel centres further away than this, in x and y; pixels."""
    if plan.footprint is not None:
        return (plan.footprint.half_width, plan.footprint.half_height)
    if plan.slabs is not None:
        aside = plan.slabs.baseline + SLAB_ROUNDING
        return (plan.slabs.half_extents[0] + aside, plan.slabs.half_extents[1] + aside)
    if plan.reach == Reach.PIXEL:
        return (NEAREST, NEAREST)
    sheet, *within = plan.traversal.axes
    largest = [max(visits.block_sizes()) for visits in plan.visits]
    # Where a ray enters or leaves a sheet it has gone aside in it by no more than half the way through it
    half_x, half_y = (
        sum(abs(dda.half_steps[axis]) * (largest[axis] + largest[sheet]) for axis in within) / FIXED_ONE
        for dda in (plan.x, plan.y)
    )
    return (half_x, half_y)


def _numbers(dda: Dda) -> tuple[int, int, int, int]:
    return (dda.origin, *dda.half_steps)
