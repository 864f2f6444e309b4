"""How often the values of a whole volume occur, and the statistics that its scenes are placed by.

The counts are the survey's, those of all voxels whatever the partition, and nothing here depends on a window.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property


@dataclass(frozen=True)
class ValueCounts:
    """Counts of values in bins that split low..high evenly; NaN is left out."""

    low: float
    high: float
    counts: Sequence[int]

    @cached_property
    def _occupied(self) -> list[tuple[float, int]]:
        """The middles of the bins that hold something, rising, and how many they hold."""
        width = (self.high - self.low) / len(self.counts)
        return [(self.low + (n + 0.5) * width, count) for n, count in enumerate(self.counts) if count]

    @property
    def different(self) -> int:
        """How many values there are, as far as bins tell them apart."""
        return len(self._occupied)

    @cached_property
    def voxels(self) -> int:
        return sum(count for _, count in self._occupied)

    @cached_property
    def mean(self) -> float:
        return sum(value * count for value, count in self._occupied) / max(self.voxels, 1)

    @cached_property
    def deviation(self) -> float:
        """The root of the mean square distance from the mean: what crystallographers call sigma of a map."""
        mean = self.mean
        squares = sum((value - mean) ** 2 * count for value, count in self._occupied)
        return math.sqrt(squares / max(self.voxels, 1))

    @cached_property
    def noise(self) -> float:
        """The deviation of noise about zero, by what lies below zero, which is nothing else; 0 without such values."""
        below = [(value, count) for value, count in self._occupied if value < 0]
        squares = sum(value * value * count for value, count in below)
        return math.sqrt(squares / sum(count for _, count in below)) if below else 0.0

    def share_above(self, value: float) -> float:
        return sum(count for middle, count in self._occupied if middle > value) / max(self.voxels, 1)

    def share_below(self, value: float) -> float:
        return sum(count for middle, count in self._occupied if middle < value) / max(self.voxels, 1)

    def percentile(self, fraction: float) -> float:
        """The least value such that at least `fraction` of the voxels do not exceed it; `low` where there are none."""
        wanted, seen = fraction * self.voxels, 0
        for value, count in self._occupied:
            seen += count
            if seen >= wanted:
                return value
        return self.low

    def enclosing(self, share: float, power: int) -> float:
        """The greatest |value| such that voxels of at least this one hold `share` of the sum of |value|^power."""
        weights = sorted(((abs(value), count * abs(value) ** power) for value, count in self._occupied), reverse=True)
        wanted = share * sum(weight for _, weight in weights)
        held = 0.0
        for value, weight in weights:
            held += weight
            if held >= wanted:
                return value
        return 0.0
