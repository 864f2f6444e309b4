"""Which pixels a sample reaches in a frame, as the splat kernel takes it (design, section 6)."""

import math

from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.frame_plan import FramePlan, Reach
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, Dda
from volsplat.splat_server._kernels import CellMap, FootprintTable
from volsplat.splat_server.footprint_table import footprint_table

PixelReach = FootprintTable | CellMap | None  # None: the nearest pixel

CELL_MARGIN = 6  # rows above and below a cell that are searched as well
CELL_ROW = 64  # pixels: what searching a row for a cell's pixels costs


def reach_and_cost(plan: FramePlan, threads: int) -> tuple[PixelReach, int]:
    """As so many threads find it; with what splatting one packet costs at most, in pixels combined.

    Raises BadInput for a footprint larger than any image.
    """
    if plan.footprint is not None:
        in_passing = plan.frozen_alpha < FROZEN_ALPHA  # nothing else has pixels frozen early
        table = footprint_table(plan.footprint, threads, in_passing)
        return table, min(table.width, plan.width) * min(table.height, plan.height)
    return (cell_map(plan), _cost_of_cell(plan)) if plan.reach == Reach.CELL else (None, 1)


def _cost_of_cell(plan: FramePlan) -> int:
    sizes = [max(visits.block_sizes()) for visits in plan.visits]  # of a block, whose outline on the screen is reached
    width, height = (
        sum(abs(half_step) * 2 * size / FIXED_ONE for half_step, size in zip(dda.half_steps, sizes, strict=True))
        for dda in (plan.x, plan.y)
    )
    rows = min(math.ceil(height) + CELL_MARGIN, plan.height)
    return rows * (min(math.ceil(width), plan.width) + CELL_ROW)


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
