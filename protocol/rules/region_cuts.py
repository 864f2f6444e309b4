"""Where an image is cut into regions, so that all owners have as long to splat.

Work is counted for each row of tiles, from the image's first line to its last.
"""

import math
from collections.abc import Sequence
from itertools import accumulate, product

from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE

SAMPLED = 8  # places on each axis of a grid
# Regions of all but low footprints are so many lines high at most, or so many footprints: then the pixels around a run
# stay in the first caches while its neighbours follow. A low footprint's do so anyway.
LOW_FOOTPRINT = 12
MOST_LINES, MOST_FOOTPRINTS = 128, 3


def cut(work: Sequence[float], lines: int, owners: Sequence[float]) -> list[int]:
    """The edges of a region for each owner: 0, where one ends and the next begins, `lines`. Regions may be empty.

    `owners` are their speeds, in any unit. `work` may be that of an image of another height, which showed the same;
    if there is none at all, lines count.
    """
    known = work if any(work) else [1.0]
    done = [0.0, *accumulate(known)]
    total, speeds = done[-1], [0.0, *accumulate(owners)]
    rows = -(-lines // TILE_SIDE)
    edges, row = [0], 0
    for speed in speeds[1:-1]:
        share = min(total * speed / speeds[-1], total)
        while done[row + 1] < share:
            row += 1
        place = (row + (share - done[row]) / (done[row + 1] - done[row])) / len(known)
        edges.append(min(round(place * rows) * TILE_SIDE, lines))
    return [*edges, lines]


def regions_each(plan: FramePlan, owners: int) -> int:
    """How many regions each of so many owners should have."""
    height = 2 * plan.footprint.half_height if plan.footprint else 0.0
    if height < LOW_FOOTPRINT:
        return 1
    return math.ceil(plan.height / (owners * max(MOST_LINES, MOST_FOOTPRINTS * height)))


def expected_work(plan: FramePlan) -> list[int]:
    """Of a frame of which nothing is known yet: as if its voxels were all alike."""
    work = [0] * -(-plan.height // TILE_SIDE)
    places = (
        [(visits.low + (visits.high - visits.low) * (n + 0.5) / SAMPLED) * 2 * half_step for n in range(SAMPLED)]
        for visits, half_step in zip(plan.visits, plan.y.half_steps, strict=True)
    )
    for place in product(*places):
        line = (plan.y.origin + sum(place)) / FIXED_ONE
        if 0 <= line < plan.height:
            work[int(line) // TILE_SIDE] += 1
    return work
