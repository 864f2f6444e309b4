"""The histogram of density bytes, and the landmarks that presets and the default scene are placed by.

Positions are those of tables: 0 is byte 0, 1 is byte 255.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.rules.index_rules import Survey
from volsplat.protocol.text.errors import BadInput

LAST = TABLE_ENTRIES - 1

SMOOTHING = 1.5  # standard deviation in bytes: enough to join the comb that few distinct values leave

ZERO_SPAN = 0.1  # of a window: data with less than this on one side of zero counts as one-signed noise
AIR_HU = -1000.0
TISSUE_HU = 40.0
# Where a CT's air and soft tissue lie when there is no volume to ask: stored as HU + 1024, window 0..2550.
ASSUMED_AIR = 24 / 2550
ASSUMED_TISSUE = 1064 / 2550

# What tells a CT of a body from other data, in Hounsfield units and shares of the voxels.
LEAST_AIR = 0.03  # within AIR_WIDTH of the air's peak
AIR_WIDTH = 150.0
MOST_BELOW_AIR = 0.002  # but for the lowest byte, where scanners put their padding
LEAST_BONE = 0.003  # at BONE_HU or above
BONE_HU = 300.0
TISSUE_WIDTH = 200.0  # soft tissue is a peak narrower than this at half its height
VALLEY = 0.25  # of that height, at most: the least count between air and tissue
LEAST_BYTES = 40  # that occur from air to tissue; fewer are labels or a scale too coarse to tell


@dataclass(frozen=True)
class DensityHistogram:
    """How many voxels have each density byte, NaN left out, under a window in the data's units."""

    window: tuple[float, float]
    counts: tuple[int, ...]  # 256 of them

    @property
    def voxels(self) -> int:
        return sum(self.counts)

    def position(self, value: float) -> float:
        """The table position of a value in the data's units: at an end of the table if it is outside of the window."""
        return _within(self.place(value))

    def place(self, value: float) -> float:
        """The same, but below 0 and above 1 outside of the window."""
        low, high = self.window
        return (value - low) / (high - low)

    def share_above(self, byte: int) -> float:
        """The share of the voxels whose density byte is greater."""
        return sum(self.counts[byte + 1 :]) / max(self.voxels, 1)

    def share_below(self, byte: int) -> float:
        return sum(self.counts[:byte]) / max(self.voxels, 1)

    def byte_at_share(self, fraction: float) -> int:
        """The least byte at or below which at least `fraction` of the voxels lie."""
        seen = 0
        for byte, count in enumerate(self.counts):
            seen += count
            if seen >= fraction * self.voxels and seen:
                return byte
        return LAST

    def smoothed(self) -> list[float]:
        """The counts under a small Gaussian, so that a peak is not a single crowded value."""
        reach = math.ceil(3 * SMOOTHING)
        weights = [math.exp(-0.5 * (n / SMOOTHING) ** 2) for n in range(-reach, reach + 1)]
        padded = [0] * reach + list(self.counts) + [0] * reach
        return [
            sum(w * c for w, c in zip(weights, padded[byte : byte + 2 * reach + 1], strict=True))
            for byte in range(TABLE_ENTRIES)
        ]


def density_histogram(survey: Survey, counts: list[int], window: tuple[float, float]) -> DensityHistogram:
    """The bytes' counts from the survey's histogram, whose bins split the values' range in survey.ranges evenly.

    Raises BadInput for a window too narrow for a scale.
    """
    low, high = window
    scale = LAST / (high - low)
    if math.isinf(scale):
        raise BadInput(f"the values differ by no more than {high - low:g}, too little to tell apart; scale them up")
    ranges = survey.ranges
    width = (ranges.high - ranges.low) / len(counts)
    values = ranges.low + (np.arange(len(counts)) + 0.5) * width
    with np.errstate(over="ignore"):
        places = (values - low) * scale
    return DensityHistogram(window, summed_by_byte(places, counts))


def summed_by_byte(places: NDArray[np.floating[Any]], counts: Sequence[int]) -> tuple[int, ...]:
    """The counts of all bins whose places, from 0 to 255, become the same byte."""
    sums = np.zeros(TABLE_ENTRIES, np.int64)
    np.add.at(sums, (np.clip(places, 0.0, LAST) + 0.5).astype(np.intp), counts)
    return tuple(sums.tolist())


def window_of_shares(survey: Survey, counts: list[int], low: float, high: float) -> tuple[float, float]:
    """The densities between which all voxels lie but for a share of `low` below and of 1 - `high` above.

    They are the outer edges of the bins of the survey's histogram that those shares end in.
    """
    ranges = survey.ranges
    width = (ranges.high - ranges.low) / len(counts)
    seen = list(accumulate(counts))
    first = bisect_right(seen, low * seen[-1]) if low * seen[-1] < seen[-1] else 0
    last = min(bisect_left(seen, high * seen[-1]), len(counts) - 1)
    return (ranges.low + first * width, min(ranges.low + (last + 1) * width, ranges.high))


def otsu_byte(counts: list[float]) -> int:
    """The byte that splits the counts into two classes of least spread: the lower class is <= it (Otsu 1979).

    Between two separate peaks every byte of the gap splits alike; the middle of the gap is returned.
    """
    total = sum(counts)
    moment = sum(byte * count for byte, count in enumerate(counts))
    best, first, last = -1.0, 0, 0
    below, below_moment = 0.0, 0.0
    for byte, count in enumerate(counts[:-1]):
        below += count
        below_moment += byte * count
        above = total - below
        if below <= 0 or above <= 0:
            continue
        spread = below * above * (below_moment / below - (moment - below_moment) / above) ** 2
        if spread > best * (1 + 1e-12):
            best, first, last = spread, byte, byte
        elif spread >= best * (1 - 1e-12):
            last = byte
    return (first + last) // 2


@dataclass(frozen=True)
class CtScale:
    """Hounsfield units on a table, by the two peaks that every CT of a body has."""

    air: float  # positions
    tissue: float

    def position(self, hounsfield: float) -> float:
        """On the table: at an end of it outside of the window."""
        return _within(self.place(hounsfield))

    def place(self, hounsfield: float) -> float:
        """The same, but below 0 and above 1 outside of the window."""
        per_unit = (self.tissue - self.air) / (TISSUE_HU - AIR_HU)
        return self.air + (hounsfield - AIR_HU) * per_unit

    def moved(self, window: tuple[float, float], other: tuple[float, float]) -> "CtScale":
        """From a table under one window to that under another."""
        (low, high), (other_low, other_high) = window, other
        stretch, shift = (high - low) / (other_high - other_low), (low - other_low) / (other_high - other_low)
        return CtScale(self.air * stretch + shift, self.tissue * stretch + shift)


def _within(place: float) -> float:
    return min(max(place, 0.0), 1.0)


def ct_scale(histogram: DensityHistogram | None) -> CtScale:
    """The scale of a CT by its air and soft-tissue peaks, the highest on either side of Otsu's threshold."""
    if histogram is None or histogram.voxels == 0:
        return CtScale(ASSUMED_AIR, ASSUMED_TISSUE)
    counts = histogram.smoothed()
    split = otsu_byte(counts)
    air = max(range(split + 1), key=lambda byte: counts[byte])
    tissue = max(range(split + 1, TABLE_ENTRIES), key=lambda byte: counts[byte])
    return CtScale(air / LAST, tissue / LAST)


def recognised_ct(histogram: DensityHistogram | None) -> CtScale | None:
    """The scale of what is certainly a CT of a body: a crowd at air, a narrow soft-tissue peak, some bone.

    None for anything else, and if there is no histogram.
    """
    if histogram is None or histogram.voxels == 0:
        return None
    scale = ct_scale(histogram)
    air, tissue = round(scale.air * LAST), round(scale.tissue * LAST)
    if tissue - air - histogram.counts[air:tissue].count(0) < LEAST_BYTES:
        return None
    smoothed = histogram.smoothed()
    half = smoothed[tissue] / 2
    first = next((byte for byte in range(tissue, air, -1) if smoothed[byte] < half), air)
    last = next((byte for byte in range(tissue, TABLE_ENTRIES) if smoothed[byte] < half), TABLE_ENTRIES)
    per_byte = (TISSUE_HU - AIR_HU) / (tissue - air)
    reach = round(AIR_WIDTH / per_byte)
    below_air = sum(histogram.counts[1 : max(air - reach, 1)])
    at_air = sum(histogram.counts[max(air - reach, 0) : air + reach + 1])
    bone = histogram.share_above(tissue + math.ceil((BONE_HU - TISSUE_HU) / per_byte) - 1)
    is_ct = (
        at_air >= LEAST_AIR * histogram.voxels
        and below_air <= MOST_BELOW_AIR * histogram.voxels
        and min(smoothed[air:tissue]) <= VALLEY * smoothed[tissue]
        and (last - first) * per_byte <= TISSUE_WIDTH
        and bone >= LEAST_BONE
    )
    return scale if is_ct else None


@dataclass(frozen=True)
class Landmarks:
    """Where a volume that is not a CT passes from background to what there is to see."""

    background: float  # positions, in rising order; nothing at or below it is meant to be seen
    object: float
    middle: float
    core: float  # all but the densest hundredth of the object lies below


SEEN_SHARE = 0.35  # of the voxels, at most: more would hide itself


def landmarks(histogram: DensityHistogram | None) -> Landmarks:
    """Background, object and core by Otsu's threshold, raised where too much would be seen."""
    if histogram is None or histogram.voxels == 0:
        return Landmarks(0.15, 0.35, 0.55, 0.85)
    split = max(otsu_byte(histogram.smoothed()), histogram.byte_at_share(1 - SEEN_SHARE))
    split = min(split, LAST - 3)
    seen = histogram.share_above(split)
    core = max(histogram.byte_at_share(1 - 0.01 * seen), split + 3)
    step = (core - split) / LAST
    start = split / LAST
    return Landmarks(start, start + step / 3, start + step * 2 / 3, core / LAST)


def zero_position(histogram: DensityHistogram | None) -> float | None:
    """Where zero lies on a table for data of both signs; None for any other, or none."""
    if histogram is None:
        return None
    low, high = histogram.window
    if not low < 0 < high:
        return None
    zero = histogram.position(0.0)
    return zero if ZERO_SPAN <= zero <= 1 - ZERO_SPAN else None
