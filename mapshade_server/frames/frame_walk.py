"""One frame of a map/shade server: gives the kernel a plan's and a scene's numbers, and hands out its batches."""

from collections.abc import Sequence

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.sub_cube import SubCube, mixture_of
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import FramePlan, Reach
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, Dda
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.rules.slab_kernels import LEAST_KNOWN

DEFAULT_PACKETS = 1 << 17  # 1 MiB of all walkers: few hand-overs, and the next stage still finds it in the cache
LEAST_PACKETS = 1 << 16  # of one walker of many: each hand-over takes the interpreter, which they all share
STEP_PACKETS = 1 << 14  # within a process, where handing over costs nothing
DEFAULT_VOXELS = 1 << 22  # some 5 ms where each of them must be looked at, so that an abort is heard soon

SLAB_PACKETS = 1 << 14  # of a batch of unshaded voxels: few of those that follow are then hidden
SLAB_ROUNDING = 1.0  # pixels: by which a voxel may be moved on its way to the planes, at most

NEAREST = 0.5  # pixels: no centre of a pixel is further away than the nearest one

FIELDS = list(Field)  # the kernel knows fields by their place here


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
        self.closed_tiles = closed_tiles if drawing.plan.hides else None
        walk_of = _sheet_walk if drawing.plan.slabs is None else _slab_walk
        walk = walk_of(sub_cubes, drawing, self.closed_tiles, regions, walkers)
        self.walkers = [walk.walker(number) for number in range(walk.walkers)]


def _sheet_walk(
    sub_cubes: Sequence[SubCube],
    drawing: Drawing,
    closed_tiles: "_kernels.Array | None",
    regions: Sequence[Region],
    walkers: int | None,
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
        limits=(max(DEFAULT_PACKETS // walkers, LEAST_PACKETS) if walkers else STEP_PACKETS, DEFAULT_VOXELS),
    )


def _slab_walk(
    sub_cubes: Sequence[SubCube],
    drawing: Drawing,
    closed_tiles: "_kernels.Array | None",
    regions: Sequence[Region],
    walkers: int | None,
) -> _kernels.SlabWalk:
    """By groups of planes from the front, unshaded: the voxels that slabs take."""
    plan, slabs = drawing.plan, drawing.plan.slabs
    assert slabs is not None
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
