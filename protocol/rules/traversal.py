"""The order in which samples are visited (paper: "Screen Mapping").

A ray to the viewer changes i, j and k at constant rates. The axis that changes most is the outermost loop (sheet),
the one that changes least the innermost (sample). A zero delta counts as positive; of equal magnitudes k comes
before j before i. For footprints deltas count times the distance of layers, so that the sheets are those that face the
viewer most.
"""

import math

import msgspec

from volsplat.protocol.description.scene import Order
from volsplat.protocol.description.volume import LONGEST_AXIS, Index
from volsplat.protocol.rules.refinement import GREATEST_STRIDE


class Traversal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Nested loops over (sheet, row, sample): grid axis numbers (0 = i) and whether each runs upwards."""

    axes: Index
    ascending: tuple[bool, bool, bool]

    def __post_init__(self) -> None:
        if sorted(self.axes) != [0, 1, 2]:
            raise ValueError(f"a traversal has each of the axes 0, 1 and 2 once, not {self.axes}")

    def on_axes(self, by_level: Index) -> Index:
        """What is given for sheet, row and sample, for i, j and k."""
        i, j, k = (by_level[self.axes.index(axis)] for axis in range(3))
        return (i, j, k)

    def place(self, index: Index) -> Index:
        """What sorts the voxels at i, j and k as they are visited."""
        sheet, row, sample = (
            index[axis] if up else -index[axis] for axis, up in zip(self.axes, self.ascending, strict=True)
        )
        return (sheet, row, sample)


EVERY_LAYER_ALIKE: Index = (1, 1, 1)


def traversal_of(ray: Index, order: Order, distances: Index = EVERY_LAYER_ALIKE) -> Traversal:
    """The traversal for a ray that runs to the viewer by `ray` in i, j and k (any unit).

    With equal spacings the ray's deltas are those of depth, dz/di, dz/dj and dz/dk, that the paper inspects. With
    unequal ones or skew they are not: rays cross the grid's cells by the rule here, whatever the spacings. Loops that
    each run the way of the ray visit what is behind and what is before in order, however they are nested. Which is the
    outer one is free, where `distances` of layers say it.
    """
    axes = sorted((2, 1, 0), key=lambda axis: -abs(ray[axis]) * distances[axis])
    back_to_front = order == Order.BACK_TO_FRONT
    sheet, row, sample = axes
    return Traversal(
        axes=(sheet, row, sample),
        ascending=(
            (ray[sheet] >= 0) == back_to_front,
            (ray[row] >= 0) == back_to_front,
            (ray[sample] >= 0) == back_to_front,
        ),
    )


class AxisVisits(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """The indices that a step visits on one axis, and the block of voxels that each of them stands for.

    Visited are `first`, `first + stride`, …: `count` of them. Their blocks partition low..high: a block reaches
    from `index - stride // 2` over `stride` voxels, but the outermost ones reach to the bounds.
    """

    low: int
    high: int
    stride: int
    first: int
    count: int

    def __post_init__(self) -> None:
        if not (
            0 <= self.low <= self.first < self.high <= LONGEST_AXIS
            and self.first - self.low < self.stride <= GREATEST_STRIDE
            and self.count == (self.high - 1 - self.first) // self.stride + 1
        ):
            raise ValueError(
                f"an axis cannot be visited at every {self.stride} of {self.low}..{self.high}, from {self.first} on "
                f"{self.count} times"
            )

    def index(self, ordinal: int) -> int:
        return self.first + self.stride * ordinal

    def block(self, ordinal: int) -> tuple[int, int]:
        start = self.index(ordinal) - self.stride // 2
        return (
            self.low if ordinal == 0 else start,
            self.high if ordinal == self.count - 1 else start + self.stride,
        )

    def block_sizes(self) -> tuple[int, int, int]:
        """How many voxels the first block, those between, and the last one have."""
        first, last = self.block(0), self.block(self.count - 1)
        return (first[1] - first[0], self.stride, last[1] - last[0])


def mean_stride(strides: Index) -> float:
    """That on all axes alike by which as many voxels would be visited."""
    i, j, k = strides
    return float(i) if i == j == k else math.cbrt(i * j * k)


def visits_of(low: int, high: int, stride: int) -> AxisVisits:
    """The visits to low..high: indices congruent to stride // 2, or the middle where there is none."""
    phase = stride // 2
    first = low + (phase - low) % stride
    if first >= high:
        return AxisVisits(low=low, high=high, stride=stride, first=(low + high) // 2, count=1)
    return AxisVisits(low=low, high=high, stride=stride, first=first, count=(high - 1 - first) // stride + 1)
