"""The voxels that lie under a point of the image, front to back: what a probe of the picture looks at.

A sheet's cells are parallelograms on the screen. Of each sheet those voxels lie under the point whose cell holds it,
and those that are within half a pixel of it, but none more than MOST_ASIDE voxels aside: a pixel that shows ever so
many voxels is answered as fast as any other.
"""

import math
from collections.abc import Iterator

import msgspec

from volsplat.protocol.description.scene import Order, Scene, Step
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.rules.frame_plan import FIXED_ONE, plan_frame
from volsplat.protocol.rules.levels import Resolution

HALF = 0.5  # of a cell, and of a pixel
MOST_ASIDE = 2.0  # voxels


class LineOfSight:
    """A line from a point of the image into the volume."""

    def __init__(
        self, scene: Scene, geometry: Geometry, x: float, y: float, resolution: Resolution | None = None
    ) -> None:
        """x and y are pixels from the centre of the image's top left pixel, x to the right and y down.

        It runs through the level of `resolution`, or where there is none through the volume itself; indices are the
        level's. Raises ValueError where bounds or view do not fit the volume.
        """
        self.plan = plan_frame(msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK), geometry, Step.F, resolution)
        self._inside = 0 <= x + HALF < self.plan.width and 0 <= y + HALF < self.plan.height
        self._x = x - self.plan.x.origin / FIXED_ONE
        self._y = y - self.plan.y.origin / FIXED_ONE
        across, down, _ = self.plan.pixels_per_index
        sheet, row, sample = self.plan.traversal.axes
        self._sheet = (across[sheet], down[sheet])  # pixels for a step from sheet to sheet, and within one
        self._row = (across[row], down[row])
        self._sample = (across[sample], down[sample])
        self._area = across[row] * down[sample] - across[sample] * down[row]

    def place(self, index: Index) -> Index:
        """What sorts voxels from front to back."""
        i, j, k = (
            index[axis] if up else -index[axis]
            for axis, up in zip(self.plan.traversal.axes, self.plan.traversal.ascending, strict=True)
        )
        return (i, j, k)

    def voxels(self, box: Box) -> Iterator[Index]:
        """Those of the box, within the bounds, that lie under the point, front to back."""
        if not self._inside:
            return
        sheets, rows, samples = (self._range(box, axis) for axis in self.plan.traversal.axes)
        aside_row = self._aside(self._sample)
        aside_sample = self._aside(self._row)
        for sheet in self._in_order(0, sheets):
            row_there, sample_there = self._crossing(sheet)
            for row in self._in_order(1, _around(row_there, aside_row, rows)):
                for sample in self._in_order(2, _around(sample_there, aside_sample, samples)):
                    if self._is_under(row - row_there, sample - sample_there):
                        yield self._index(sheet, row, sample)

    def _range(self, box: Box, axis: int) -> range:
        bounds = self.plan.bounds
        return range(max(box.low[axis], bounds.low[axis]), min(box.high[axis], bounds.high[axis]))

    def _aside(self, other: tuple[float, float]) -> float:
        """How far along an axis of the sheet voxels under the point may be, `other` being its other axis."""
        half_pixel = HALF * (abs(other[0]) + abs(other[1])) / abs(self._area)
        return max(HALF, min(MOST_ASIDE, half_pixel))

    def _in_order(self, loop: int, indices: range) -> range:
        return indices if self.plan.traversal.ascending[loop] else indices[::-1]

    def _crossing(self, sheet: int) -> tuple[float, float]:
        """Where in a sheet the line crosses it: row and sample."""
        x, y = self._x - sheet * self._sheet[0], self._y - sheet * self._sheet[1]
        return (
            (x * self._sample[1] - y * self._sample[0]) / self._area,
            (y * self._row[0] - x * self._row[1]) / self._area,
        )

    def _is_under(self, rows: float, samples: float) -> bool:
        """Whether a voxel so far from the crossing lies under the point."""
        if abs(rows) <= HALF and abs(samples) <= HALF:
            return True
        x = rows * self._row[0] + samples * self._sample[0]
        y = rows * self._row[1] + samples * self._sample[1]
        return abs(x) <= HALF and abs(y) <= HALF

    def _index(self, *place: int) -> Index:
        by_axis = dict(zip(self.plan.traversal.axes, place, strict=True))
        return (by_axis[0], by_axis[1], by_axis[2])


def _around(middle: float, aside: float, within: range) -> range:
    low = max(math.ceil(middle - aside), within.start)
    return range(low, max(low, min(math.floor(middle + aside) + 1, within.stop)))
