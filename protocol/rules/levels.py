"""Drawing a volume that was prepared at several resolutions: which of them a step takes, and where its grid lies.

Level 0 is the volume itself. Each further level halves axes of the grid (not those of one voxel, nor of much longer
steps than others): voxel n of a level stands for the voxels f n to f (n + 1) - 1 of level 0, f being its factor on that
axis, so its middle lies at level 0's f (n + 1/2) - 1/2. A scene always speaks of level 0's grid and spacing, whatever
level is drawn.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import msgspec

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.protocol.rules.index_rules import Quantisation, Survey
from volsplat.protocol.rules.refinement import GREATEST_STRIDE, STEP_RULES

# What lists of the voxels that can be seen may take, of the packets' bytes: a tenth of the voxels on three axes. Of
# packets that come from a store less: with what is held while bricks are unpacked instead, a server never takes more
# than 1.5 times its packets.
LISTS_PER_PACKET = 0.65
LISTS_PER_STORED_PACKET = 0.4


class Prepared(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was decided of a volume when it was prepared."""

    survey: Survey
    quantisation: Quantisation
    levels: tuple[Geometry, ...]  # finest first; the first is the volume's own


class Thinning(NamedTuple):
    """What a frame leaves out of the voxels that its step draws as a rule.

    Sheets lie one behind the other, so that leaving out some of them harms a picture least; then rows.
    """

    octaves: int = 0  # by which all axes are coarser
    sheets: int = 1  # every how many of these are left
    rows: int = 1
    frozen_alpha: float = FROZEN_ALPHA  # front to back: what lies behind this is left out

    @property
    def one_in(self) -> int:
        """Of so many voxels one is drawn, if octaves halve all axes: of thick slices a coarser level leaves more."""
        return self.sheets * self.rows << 3 * self.octaves


ALL_VOXELS = Thinning()


class Resolution(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a frame is drawn from: a level, and every how many of its samples on each axis.

    On those of sheets and rows `stride` counts so many times.
    """

    level: int
    geometry: Geometry  # the level's
    stride: int
    sheets: int = 1
    rows: int = 1
    frozen_alpha: float = FROZEN_ALPHA

    def __post_init__(self) -> None:
        if self.level < 0:
            raise ValueError(f"a resolution needs a level from 0 on, not {self.level}")
        if min(self.strides) < 1 or max(self.strides) > GREATEST_STRIDE:
            raise ValueError(f"a resolution's strides must be 1 to {GREATEST_STRIDE}, not {self.strides}")

    @property
    def strides(self) -> Index:
        """Of sheets, rows and samples."""
        return (self.stride * self.sheets, self.stride * self.rows, self.stride)


def own_resolution(geometry: Geometry, step: Step, thinning: Thinning = ALL_VOXELS) -> Resolution:
    """A volume without further levels: it is strided, as in the paper."""
    stride = STEP_RULES[step].stride << thinning.octaves
    return _thinned(thinning, 0, geometry, stride)


def resolution_of(
    step: Step, levels: Sequence[Geometry], base: int, striding: bool, thinning: Thinning = ALL_VOXELS
) -> Resolution:
    """What `step` is drawn from where the finest step takes level `base`, and leaves out what `thinning` says.

    Coarser steps take coarser levels, whose voxels are means, unless `striding`; where there are no more, they stride.
    """
    octaves = STEP_RULES[step].octaves + thinning.octaves
    coarser = 0 if striding else min(octaves, len(levels) - 1 - base)
    level, stride = base + coarser, 1 << (octaves - coarser)
    return _thinned(thinning, level, levels[level], stride)


def _thinned(thinning: Thinning, level: int, geometry: Geometry, stride: int) -> Resolution:
    return Resolution(level, geometry, stride, thinning.sheets, thinning.rows, thinning.frozen_alpha)


def levels_drawn(levels: Sequence[Geometry], base: int) -> range:
    """The levels that the steps of a frame take."""
    return range(base, min(base + max(rule.octaves for rule in STEP_RULES.values()), len(levels) - 1) + 1)


@lru_cache(maxsize=64)
def factors_of(geometry: Geometry, level: Geometry) -> Index:
    """How many voxels of the volume each voxel of a level stands for along i, j, k.

    Raises ValueError where it is no level of the volume.
    """
    ratios = [coarse / fine for coarse, fine in zip(level.spacing, geometry.spacing, strict=True)]
    if not all(math.isfinite(ratio) for ratio in ratios):
        raise ValueError(f"spacing {level.spacing} is that of no level of a volume whose spacing is {geometry.spacing}")
    i, j, k = (round(ratio) for ratio in ratios)
    if min(i, j, k) < 1 or level.dims != dims_at_level(geometry.dims, (i, j, k)):
        raise ValueError(
            f"{level.dims} voxels, each of {i} x {j} x {k}, are no level of a volume of {geometry.dims} voxels"
        )
    return (i, j, k)


def dims_at_level(dims: Index, factors: Index) -> Index:
    """How many voxels a level of a volume has along i, j, k."""
    i, j, k = (-(-size // factor) for size, factor in zip(dims, factors, strict=True))
    return (i, j, k)


@lru_cache(maxsize=64)
def thickness_of(geometry: Geometry, level: Geometry) -> float:
    """The level's reference spacing in those of the volume."""
    return level.reference_spacing / geometry.reference_spacing


def point_at_level(point: Vector, factors: Index) -> Vector:
    """Where a point of the volume's grid lies in a level's."""
    i, j, k = (x if f == 1 else (x + 0.5) / f - 0.5 for x, f in zip(point, factors, strict=True))
    return (i, j, k)


def bounds_at_level(box: Box, factors: Index) -> Box:
    """The voxels of a level that hold any of a box of the volume."""
    i0, j0, k0 = (n // f for n, f in zip(box.low, factors, strict=True))
    i1, j1, k1 = (-(-n // f) for n, f in zip(box.high, factors, strict=True))
    return Box((i0, j0, k0), (i1, j1, k1))


def share_at_level(box: Box, factors: Index) -> Box:
    """The part of a level for who holds this box of the volume: parts of a partition partition every level.

    It may be empty.
    """
    i0, j0, k0 = (-(-n // f) for n, f in zip(box.low, factors, strict=True))
    i1, j1, k1 = (-(-n // f) for n, f in zip(box.high, factors, strict=True))
    return Box((i0, j0, k0), (i1, j1, k1))


def index_in_volume(index: Index, factors: Index, dims: Index) -> Index:
    """The voxel of the volume in the middle of a level's voxel, the upper one of two."""
    i, j, k = (min(n * f + f // 2, size - 1) for n, f, size in zip(index, factors, dims, strict=True))
    return (i, j, k)


def finest_needed(levels: Sequence[Geometry], zoom: float) -> int:
    """The coarsest level whose voxels are no larger than a pixel; level 0 where none is.

    How large a voxel is its reference spacing says: slices may be thicker than a pixel, even at level 0, while voxels
    are narrower. `zoom` is pixels per reference spacing of the volume.
    """
    sizes = (zoom * thickness_of(levels[0], level) for level in levels)
    return max((n for n, size in enumerate(sizes) if size <= 1.0 or math.isclose(size, 1.0)), default=0)
