"""What becomes 8 bits, by one rule for the whole volume (design, section 3.7). Arithmetic is IEEE float64.

density     byte = floor(min(max((v - low) * scale, 0), 255) + 0.5), scale = 255 / (high - low)
strength    byte = floor(min(max((s - strength_low) * strength_scale, 0), 255) + 0.5), s = |gradient| per unit of
            physical length and strength_low = 0, or s the volume's second scalar, over its range; 0 where s is NaN
gradient i, j, k
            byte = floor(128.5 + 127 * c), c the component of the unit direction along the physical direction
            of that grid axis; 128 where there is no gradient
grid        byte = floor(256 * index / dims)
screen      byte = floor(256 * (s + r) / (2 r)), s measured from the centre of the volume's bounding sphere of
            radius r, x to the right, y up, z towards the viewer (see frame_plan for the fixed-point form)

The direction code is 15 bits. Octahedral: with p = (x, y, z) / (|x| + |y| + |z|), and for z < 0 the fold
(x, y) -> ((1 - |y|) sign x, (1 - |x|) sign y) where sign 0 is +1, u = floor((x + 1) * 90 + 0.5) and likewise v;
code = 181 v + u. Paper: code = (x + 16) | (y + 16) << 5 | (z + 16) << 10 with the components scaled so that the
largest is 15, rounded half away from zero. Directions are in physical space and point to rising density.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import accumulate
from typing import Literal

import msgspec

from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.kind import CLASS_KINDS, Kind
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix

DirectionCode = Literal["octahedral", "paper", "rough"]

OCTAHEDRAL_SIDE = 181
OCTAHEDRAL_NO_GRADIENT = OCTAHEDRAL_SIDE * OCTAHEDRAL_SIDE  # 32761
PAPER_NO_GRADIENT = 16 | 16 << 5 | 16 << 10
DIRECTION_CODES = 32768

# Coarser levels of a prepared volume have the code "rough": an octahedral one of 89 x 89 directions, four times over,
# for the less the gradients that it stands for agree, the wider is what light falls on spread about their mean.
ROUGH_SIDE = 89
ROUGH_DIRECTIONS = ROUGH_SIDE * ROUGH_SIDE
ROUGH_NO_GRADIENT = OCTAHEDRAL_NO_GRADIENT
ROUGHNESSES = 4

# Where gradients cancel since both faces of something thin lie in one voxel, it has their common axis for a direction,
# in another octahedral code, which follows those; and light falls on either face.
TWO_FACED_SIDE = 31
TWO_FACED_DIRECTIONS = TWO_FACED_SIDE * TWO_FACED_SIDE
FIRST_TWO_FACED = ROUGHNESSES * ROUGH_DIRECTIONS

# Cosines of the angles between the mean and eight directions that are equally likely, for each roughness: quantiles
# of von Mises and Fisher's distribution, the means of which are about 1, 0.88, 0.7 and 0.4.
ROUGHNESS_COSINES = (
    (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    (0.992, 0.975, 0.955, 0.931, 0.901, 0.860, 0.799, 0.667),
    (0.980, 0.937, 0.887, 0.826, 0.750, 0.649, 0.495, 0.167),
    (0.955, 0.856, 0.743, 0.609, 0.445, 0.235, -0.057, -0.543),
)
AGREEMENTS = tuple(sum(cosines) / len(cosines) for cosines in ROUGHNESS_COSINES)
LEAST_ALONG_AXIS = 0.85  # of the squares of gradients that cancel, along one axis, for a voxel to be two-faced
OF_FACING = 0.85  # how much more of the light counts on a face that is turned to the viewer than on the one behind it

HISTOGRAM_BINS = 65536
EIGHT_BITS = {"uint8": (0.0, 255.0), "int8": (-128.0, 127.0)}
WINDOW_SHARES = (0.0005, 0.9995)  # of the voxels, that lie below the density window's ends
FEWEST_BINS = 256  # of a histogram, that the density window may take: fewer are coarser than its bytes
ROUNDING = 1e-9  # of a bin, by which its edge may be off
NARROWEST = 2.0**-64  # of the whole range of values, that histograms are counted over
STEEPER = 8.0  # gradients beside their values' range than in all of the volume, at most
STRENGTH_PERCENTILE = 0.995  # of the voxels that have a gradient; above it, strength is 255


class Quantisation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The numbers that every server of a session quantises with."""

    window: tuple[float, float]
    strength_scale: float  # bytes per unit of |gradient|, or of the second scalar
    directions: Literal["octahedral", "paper"] = "octahedral"
    strength_low: float = 0.0  # what becomes byte 0
    has_strength: bool = True  # False if a second scalar takes the place of gradient strength

    def __post_init__(self) -> None:
        low, high = self.window
        if not low < high or not math.isfinite(low) or not math.isfinite(self.density_scale) or self.density_scale <= 0:
            raise ValueError(
                f"the density window must be finite and rise, by no more than float64 can divide, not {low} to {high}"
            )
        if not 0.0 <= self.strength_scale < math.inf or not math.isfinite(self.strength_low):
            strengths = f"{self.strength_scale} from {self.strength_low} on"
            raise ValueError(
                f"strength must have a finite scale, not below 0, and a finite least value, not {strengths}"
            )

    def directions_at(self, factors: Index) -> DirectionCode:
        """The code of the level each voxel of which stands for so many of the volume's."""
        return self.directions if factors == (1, 1, 1) else "rough"

    @property
    def density_scale(self) -> float:
        return (TABLE_ENTRIES - 1) / (self.window[1] - self.window[0])

    def density_of_byte(self, byte: int) -> float:
        """The middle of the values that become this byte; of those beyond the window its end."""
        return self.window[0] + byte / self.density_scale

    def strength_of_byte(self, byte: int) -> float:
        """Likewise, |gradient| per unit of physical length, 0 in a volume without gradients; or the second scalar."""
        return self.strength_low + byte / self.strength_scale if self.strength_scale else self.strength_low


class CountedRanges(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the bins of a volume's histograms split evenly; what lies beyond counts in the outermost bins."""

    low: float  # of the values
    high: float
    max_gradient: float  # of |gradient|, from 0 on


class Survey(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Counts over voxels, from which the rules of the whole volume are made. Those of boxes add up."""

    low: float  # least and greatest value that is not NaN; low > high where there is none
    high: float
    max_gradient: float  # greatest |gradient|
    voxels: int
    no_data: int  # voxels that are NaN
    counted: CountedRanges | None = None  # if its histograms are of narrower ranges (see narrowed)

    @property
    def ranges(self) -> CountedRanges:
        """What its histograms are counted over."""
        return self.counted or CountedRanges(self.low, self.high, self.max_gradient)

    def joined(self, other: "Survey") -> "Survey":
        return Survey(
            low=min(self.low, other.low),
            high=max(self.high, other.high),
            max_gradient=max(self.max_gradient, other.max_gradient),
            voxels=self.voxels + other.voxels,
            no_data=self.no_data + other.no_data,
        )


def percentile(counts: list[int], low: float, high: float, fraction: float) -> float:
    """The value below which `fraction` of the counts lie; bins split low..high evenly, the upper edge is returned."""
    (found,) = percentiles(counts, low, high, (fraction,))
    return found


def percentiles(counts: list[int], low: float, high: float, fractions: Sequence[float]) -> list[float]:
    """Several, for which the counts are added up once."""
    up_to = list(accumulate(counts))

    def at(fraction: float) -> float:
        wanted = fraction * up_to[-1] if up_to else 0.0
        reached = bisect_left(up_to, wanted) if wanted > 0.0 else bisect_right(up_to, 0)
        return low + (high - low) * ((reached + 1) / len(counts)) if reached < len(counts) else high

    return [at(fraction) for fraction in fractions]


def narrowed(
    survey: Survey, counts: list[int], extremes: BlockExtremes, scalar_type: str, kind: Kind = Kind.UNKNOWN
) -> Survey | None:
    """The survey with narrower ranges, over which the histograms are to be counted again.

    None where `counts` of densities are good, or finer ones would tell no more. Where a few voxels lie so far from all
    others that these share few bins, that is the range of all blocks within those bins.
    """
    if scalar_type in EIGHT_BITS or kind in CLASS_KINDS or not survey.low < survey.high:
        return None
    ranges, bins = survey.ranges, len(counts)
    width = (ranges.high - ranges.low) / bins
    low, high = percentiles(counts, ranges.low, ranges.high, WINDOW_SHARES)
    low = max(low - width * (1.0 + ROUNDING), ranges.low - width * ROUNDING)
    if high - low > (FEWEST_BINS - 0.5) * width or ("int" in scalar_type and width <= 1.0):
        return None
    if bins * width < NARROWEST * (survey.high - survey.low):
        return None
    within = [
        (least, greatest)
        for least, greatest in zip(extremes.least, extremes.greatest, strict=True)
        if low <= least <= greatest <= high
    ]
    least = min((least for least, _ in within), default=low)
    greatest = max((greatest for _, greatest in within), default=high)
    if not least < greatest:
        return None  # they have one value, and what differs from it is what there is to see
    steepest = min(STEEPER * (greatest - least) / (bins * width), 1.0) * ranges.max_gradient
    return msgspec.structs.replace(survey, counted=CountedRanges(least, greatest, steepest))


def density_window(
    survey: Survey, counts: list[int], scalar_type: str, kind: Kind = Kind.UNKNOWN
) -> tuple[float, float]:
    """The one density window of a volume, where the scene does not set it.

    8-bit data keeps its values (0..255, or -128..127), unless they are labels. Labels and other classes, of which the
    rare ones count as well, have their full range. Everything else is cut at its 0.05 and 99.95 percentiles, unless
    those meet, where the full range is taken. A constant volume gets a window of width 1, or more where its value is so
    great that 1 would be lost.
    """
    if scalar_type in EIGHT_BITS and kind is not Kind.LABELS:
        return EIGHT_BITS[scalar_type]
    if survey.low > survey.high:
        return (0.0, 1.0)
    ranges = survey.ranges
    low, high = percentiles(counts, ranges.low, ranges.high, WINDOW_SHARES)
    low -= (ranges.high - ranges.low) / len(counts)
    if not low < high or kind in CLASS_KINDS:
        low, high = survey.low, survey.high
    # Values too close for a scale in float64 are a constant.
    constant = not low < high or math.isinf((TABLE_ENTRIES - 1) / (high - low))
    return (low, low + max(1.0, abs(low) * 2.0**-20)) if constant else (low, high)


def strength_scale(survey: Survey, counts: list[int]) -> float:
    """Bytes per unit of |gradient|: the percentile of the voxels that have a gradient becomes 255."""
    if survey.max_gradient <= 0.0:
        return 0.0
    with_gradient = list(counts)
    with_gradient[0] = 0
    if not any(with_gradient):
        with_gradient = counts
    top = percentile(with_gradient, 0.0, survey.ranges.max_gradient, STRENGTH_PERCENTILE)
    scale = 255.0 / top
    return scale if math.isfinite(scale) else 0.0  # gradients so weak are none


def second_scalar_scale(values: tuple[float, float]) -> float:
    """Bytes per unit of a second scalar: the whole of its range is told apart."""
    return (TABLE_ENTRIES - 1) / (values[1] - values[0])


def physical_gradient(geometry: Geometry) -> Matrix:
    """The matrix that turns differences per index step into a gradient per unit of physical length."""
    return matrices.transposed(matrices.inverse(geometry.index_to_physical))


def grid_index_bytes(size: int, factor: int = 1) -> list[int]:
    """The byte of each grid index of an axis of `size` voxels; at a level, of each `factor` of them (see levels)."""
    return [256 * min(first + factor // 2, size - 1) // size for first in range(0, size, factor)]
