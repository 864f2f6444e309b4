"""Where a frame's samples lie by their ordinals alone, so that a coded batch need not say where they are.

A position is the sum of an origin and of what the ordinals of sheet, row and sample add: so many steps, and at a first
or last ordinal, where the block is clipped, how far its centre is from where that of a whole block would be.
"""

from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.traversal import AxisVisits

VOXEL_CODE = b"\xff\xff"  # with which codes of unshaded voxels begin, which say all, and no others do


def sample_lattice(plan: FramePlan) -> list[int]:
    """As kernels/batch_code.h has it: the origin's x and y, then for sheet, row and sample the last ordinal, and x and
    y of a step, at the first ordinal and at the last one; 2^-32 pixel. Then the thresholds' first and step."""
    origin, levels = [plan.x.origin, plan.y.origin], []
    for axis, ascending in zip(plan.traversal.axes, plan.traversal.ascending, strict=True):
        visits, maps = plan.visits[axis], (plan.x, plan.y)
        begin, step, at_first, at_last = _centres(visits, ascending)
        half_steps = [on_screen.half_steps[axis] for on_screen in maps]
        origin = [at + begin * half_step for at, half_step in zip(origin, half_steps, strict=True)]
        levels += [visits.count - 1, *(number * half for number in (step, at_first, at_last) for half in half_steps)]
    return [*origin, *levels, *plan.thresholds]


def _centres(visits: AxisVisits, ascending: bool) -> tuple[int, int, int, int]:
    """Doubled indices of the blocks' centres in traversal order.

    The first one's if it were not clipped, the step, and what clipping adds to the first and to the last.
    """
    last = visits.count - 1
    step = 2 * visits.stride if ascending else -2 * visits.stride

    def centre(ordinal: int) -> int:
        low, high = visits.block(ordinal if ascending else last - ordinal)
        return low + high - 1

    start = visits.index(0 if ascending else last) - visits.stride // 2
    begin = 2 * start + visits.stride - 1
    return begin, step, centre(0) - begin, centre(last) - (begin + last * step) if last else 0
