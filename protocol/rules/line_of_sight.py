"""The voxels that lie under a point of the image, front to back: what a probe of the picture looks at.

A sheet's cells are parallelograms on the screen. Of each sheet those voxels lie under the point whose cell holds it,
and those that are within half a pixel of it, but none more than MOST_ASIDE voxels aside: a pixel that shows ever so
many voxels is answered as fast as any other.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Order, Scene
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, LARGEST_POSITION, grid_on_screen
from volsplat.protocol.rules.levels import Resolution

HALF = 0.5  # of a cell, and of a pixel
MOST_ASIDE = 2.0  # voxels
LEAST_AREA = 1e-100  # square pixels: what is divided by it stays finite

Offset = tuple[float, float]  # pixels


class LineOfSight(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line from a point of the image into the volume, across the sheets of a plan (see sight_plan)."""

    x: float  # pixels from the centre of the image's top left pixel, to the right
    y: float  # likewise, down
    across: Vector  # pixels to the right for a step along i, j, k
    down: Vector

    def __post_init__(self) -> None:
        if not all(abs(step) <= LARGEST_POSITION for step in (*self.across, *self.down)):
            raise ValueError(
                f"a voxel's steps must be at most {LARGEST_POSITION} pixels, not {self.across}, {self.down}"
            )

    def check(self, plan: FramePlan) -> None:
        """Raises ValueError for a plan across whose sheets it does not go."""
        if not abs(area := self._cells(plan).area) >= LEAST_AREA:
            raise ValueError(f"a line of sight must cross sheets whose cells it can hit, not of {area} square pixels")

    def voxels(self, plan: FramePlan, box: Box) -> Iterator[Index]:
        """Those of the box, within the bounds, that lie under the point, front to back; indices are the level's."""
        if not (0 <= self.x + HALF < plan.width and 0 <= self.y + HALF < plan.height):
            return
        cells, traversal = self._cells(plan), plan.traversal
        forward, down, right = traversal.ascending
        sheets, rows, samples = (_range(box.low[axis], box.high[axis], plan, axis) for axis in traversal.axes)
        aside_row, aside_sample = cells.aside(cells.sample), cells.aside(cells.row)
        for sheet in _in_order(sheets, forward):
            row_there, sample_there = cells.crossing(sheet)
            for row in _in_order(_around(row_there, aside_row, rows), down):
                for sample in _in_order(_around(sample_there, aside_sample, samples), right):
                    if cells.lie_under(row - row_there, sample - sample_there):
                        yield traversal.on_axes((sheet, row, sample))

    def _cells(self, plan: FramePlan) -> "_SheetCells":
        sheet, row, sample = ((self.across[axis], self.down[axis]) for axis in plan.traversal.axes)
        return _SheetCells(
            x=self.x - plan.x.origin / FIXED_ONE,
            y=self.y - plan.y.origin / FIXED_ONE,
            sheet=sheet,
            row=row,
            sample=sample,
            area=row[0] * sample[1] - sample[0] * row[1],
        )


def sight_plan(scene: Scene, geometry: Geometry, resolution: Resolution | None = None) -> FramePlan:
    """The plan that lines of sight are across: of step F, front to back, upright. Raises ValueError as plan_frame."""
    front_to_back = msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK)
    return plan_frame(front_to_back, geometry, Step.F, resolution).upright


def line_of_sight(
    scene: Scene, geometry: Geometry, x: float, y: float, resolution: Resolution | None = None
) -> LineOfSight:
    """From a point of the scene's image, through the level of `resolution`, or where there is none the volume itself.

    x and y are pixels from the centre of the image's top left pixel, x to the right and y down. Raises ValueError
    where bounds or view do not fit the volume.
    """
    grid = grid_on_screen(scene, geometry, resolution.geometry if resolution else None)
    return LineOfSight(x, y, grid.pixels_per_index[0], grid.pixels_per_index[1])


@dataclass(frozen=True)
class _SheetCells:
    """How the cells of the sheets lie about the line on the screen."""

    x: float  # of the line, in pixels from the grid's origin
    y: float
    sheet: Offset  # from sheet to sheet
    row: Offset
    sample: Offset
    area: float  # of a cell, with its sign

    def aside(self, other: Offset) -> float:
        """How far along an axis of the sheet voxels under the point may be, `other` being its other axis."""
        half_pixel = HALF * (abs(other[0]) + abs(other[1])) / abs(self.area)
        return max(HALF, min(MOST_ASIDE, half_pixel))

    def crossing(self, sheet: int) -> tuple[float, float]:
        """Where in a sheet the line crosses it: row and sample."""
        x, y = self.x - sheet * self.sheet[0], self.y - sheet * self.sheet[1]
        return (
            (x * self.sample[1] - y * self.sample[0]) / self.area,
            (y * self.row[0] - x * self.row[1]) / self.area,
        )

    def lie_under(self, rows: float, samples: float) -> bool:
        """Whether a voxel so far from the crossing lies under the point."""
        if abs(rows) <= HALF and abs(samples) <= HALF:
            return True
        x = rows * self.row[0] + samples * self.sample[0]
        y = rows * self.row[1] + samples * self.sample[1]
        return abs(x) <= HALF and abs(y) <= HALF


def _range(low: int, high: int, plan: FramePlan, axis: int) -> range:
    return range(max(low, plan.bounds.low[axis]), min(high, plan.bounds.high[axis]))


def _in_order(indices: range, ascending: bool) -> range:
    return indices if ascending else indices[::-1]


def _around(middle: float, aside: float, within: range) -> range:
    low = max(math.ceil(middle - aside), within.start)
    return range(low, max(low, min(math.floor(middle + aside) + 1, within.stop)))
