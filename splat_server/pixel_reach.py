"""Which pixels a sample reaches in a frame, as the splat kernel takes it (design, section 6)."""

from volsplat.protocol.footprint_shape import footprint_shape
from volsplat.protocol.frame_plan import Dda, FramePlan, Reach
from volsplat.protocol.scene import Reconstruction
from volsplat.splat_server._kernels import CellMap, FootprintTable
from volsplat.splat_server.footprint_table import footprint_table

PixelReach = FootprintTable | CellMap | None  # None: the nearest pixel


def pixel_reach(plan: FramePlan, reconstruction: Reconstruction) -> PixelReach:
    """Raises BadInput where a footprint is larger than any image."""
    if plan.reach == Reach.FOOTPRINT:
        return footprint_table(footprint_shape(plan, reconstruction))
    return cell_map(plan) if plan.reach == Reach.CELL else None


def cell_map(plan: FramePlan) -> CellMap:
    """The cells of a frame's sheets."""
    sheet, row, sample = plan.traversal.axes

    def ordered(dda: Dda) -> tuple[int, int, int, int]:
        return (dda.origin, dda.half_steps[sheet], dda.half_steps[row], dda.half_steps[sample])

    def axis(loop: int) -> tuple[int, int, int, int, int, bool]:
        visits = plan.visits[plan.traversal.axes[loop]]
        ascending = plan.traversal.ascending[loop]
        return (visits.low, visits.high, visits.stride, visits.first, visits.count, ascending)

    return CellMap(ordered(plan.x), ordered(plan.y), (axis(0), axis(1), axis(2)))
