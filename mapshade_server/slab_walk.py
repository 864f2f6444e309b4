"""One frame of slabs of a map/shade server: hands out the voxels that it takes, unshaded, by groups of planes."""

from collections.abc import Sequence

from volsplat.mapshade_server import _kernels, shading_tables
from volsplat.mapshade_server.frame_walk import DEFAULT_VOXELS, Walker, dda_numbers
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.description.scene import TABLE_ENTRIES
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.levels import dims_at_level
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.rules.shading_rule import ShadingRule
from volsplat.protocol.rules.slab_shape import SlabShape

PACKETS = 1 << 14  # of a batch: few of those that follow are then hidden
ROUNDING = 1.0  # pixels: by how much a voxel may be moved on its way to the planes, at most


class SlabWalk:
    """Walks a server's packed sub-cubes from the front to the back, each of its walkers a part of them."""

    def __init__(
        self,
        sub_cubes: Sequence[SubCube],
        geometry: Geometry,
        shading: ShadingRule,
        plan: FramePlan,
        slabs: SlabShape,
        closed_tiles: "_kernels.Array | None",
        regions: Sequence[Region],
        walkers: int,
    ) -> None:
        """Start at the first voxel. `geometry` is the volume's; see FrameWalk. Raises ValueError."""
        self._walk = _kernels.SlabWalk(
            boxes=[(cube.packets, cube.box.low, cube.needed_voxels) for cube in sub_cubes],
            axes=plan.traversal.axes,
            ascending=plan.traversal.ascending,
            visits=[(v.low, v.high, v.stride, v.first, v.count) for v in plan.visits],
            x=dda_numbers(plan.x),
            y=dda_numbers(plan.y),
            depth=dda_numbers(slabs.depth),
            image=(plan.width, plan.height),
            reach=slab_reach(slabs),
            groups=(slabs.groups, slabs.lead, slabs.before),
            dims=dims_at_level(geometry.dims, plan.factors),
            visible=shading_tables.visibility(shading_tables.opacity_rule(shading))[: TABLE_ENTRIES // 8],
            look=slabs.looks,
            spread=slabs.needs,
            closed_tiles=closed_tiles,
            regions=[(region.begin, region.end) for region in regions] or [(0, plan.height)],
            walkers=walkers,
            limits=(PACKETS, DEFAULT_VOXELS),
        )
        self.walkers = [Walker(self._walk.walker(number), PACKETS) for number in range(walkers)]


def slab_reach(slabs: SlabShape) -> tuple[float, float]:
    """No voxel changes the colour of pixel centres further away than this, in x and y; pixels."""
    x, y, _ = slabs.half_extents
    return (x + slabs.baseline + ROUNDING, y + slabs.baseline + ROUNDING)
