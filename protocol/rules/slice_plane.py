"""A slice of a grid, straight across one of its axes: which voxels it shows, and where each stands in its picture.

The earlier of the two other axes runs along a row of the picture, the later down its columns, as in memory: a slice
across k has i to the right and j down. How it is turned for a person is the business of who draws it.
"""

from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.description.volume import LONGEST_AXIS, Box, Index
from volsplat.protocol.rules.levels import dims_at_level
from volsplat.protocol.rules.regions import Rectangle

MOST_SAMPLES = 4096  # along one side of the picture
SAMPLE_BYTES = 8  # a voxel packet, then red, green, blue and opacity

AxisNumber = Annotated[int, Meta(ge=0, le=2)]


class SlicePlane(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One voxel of every `every` along each side, the middle one of its block."""

    dims: Index  # of the grid
    axis: AxisNumber  # that it lies across
    index: Annotated[int, Meta(ge=0, lt=LONGEST_AXIS)]
    every: Annotated[int, Meta(ge=1, le=LONGEST_AXIS)] = 1

    def __post_init__(self) -> None:
        if min(self.dims) < 1 or not 0 <= self.axis <= 2 or not 0 <= self.index < self.dims[self.axis]:
            raise ValueError(f"a grid of {self.dims} voxels has no slice {self.index} across axis {self.axis}")
        if self.every < 1 or max(self.width, self.height) > MOST_SAMPLES:
            raise ValueError(
                f"a slice of {self.width} x {self.height} samples is too large; at most {MOST_SAMPLES} may be on a side"
            )

    @property
    def sides(self) -> tuple[int, int]:
        """The axes along the columns and the rows."""
        return ((1, 2), (0, 2), (0, 1))[self.axis]

    @property
    def width(self) -> int:
        return -(-self.dims[self.sides[0]] // self.every)

    @property
    def height(self) -> int:
        return -(-self.dims[self.sides[1]] // self.every)

    def sample_index(self, sample: int, axis: int) -> int:
        """Of the grid along an axis of the picture."""
        return min(sample * self.every + self.every // 2, self.dims[axis] - 1)

    def part_in(self, box: Box) -> Rectangle | None:
        """The samples that a box of the grid holds, None for none; a partition of the grid is one of the slice."""
        if not box.low[self.axis] <= self.index < box.high[self.axis]:
            return None
        (left, right), (top, bottom) = (self._samples_in(box, axis) for axis in self.sides)
        return Rectangle(left, top, right - left, bottom - top) if left < right and top < bottom else None

    def holds(self, part: Rectangle) -> bool:
        """Whether it is a part of the picture, with something in it."""
        left, top, width, height = part
        inside = left >= 0 and top >= 0 and left + width <= self.width and top + height <= self.height
        return inside and width > 0 and height > 0

    def _samples_in(self, box: Box, axis: int) -> tuple[int, int]:
        last = -(-self.dims[axis] // self.every)
        return self._first_from(box.low[axis], axis, last), self._first_from(box.high[axis], axis, last)

    def _first_from(self, index: int, axis: int, last: int) -> int:
        """The first sample whose voxel is at this index or behind it."""
        if index >= self.dims[axis]:
            return last
        sample = min(max(-(-(index - self.every // 2) // self.every), 0), last - 1)
        return sample if self.sample_index(sample, axis) >= index else last


def level_plane(dims: Index, factors: Index, axis: int, index: int, longest: int) -> SlicePlane:
    """The slice of a level's grid that holds a slice of the volume, with at most `longest` samples on a side.

    `dims` is the volume's, in whose grid the index counts. Raises ValueError if it has no such slice.
    """
    at_level = dims_at_level(dims, factors)
    SlicePlane(dims, axis, index, max(dims))
    sides = [size for n, size in enumerate(at_level) if n != axis]
    return SlicePlane(at_level, axis, index // factors[axis], max(-(-max(sides) // max(longest, 1)), 1))
