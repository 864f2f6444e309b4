"""Builds the footprint table of a view, as fine as the cache allows (paper: "Combining"; design, section 3.6)."""

import math
from functools import lru_cache

from volsplat.protocol.description.scene import Kernel
from volsplat.protocol.rules.footprint_shape import CORRECT_SPACING, GAUSSIAN_SIGMA, KAISER_BESSEL_ALPHA, FootprintShape
from volsplat.protocol.rules.packet_layout import SUBPIXEL_BITS
from volsplat.protocol.text.errors import BadInput
from volsplat.splat_server._kernels import Ellipse, FootprintTable, KernelProjection

CACHE_BUDGET = 3 << 19  # bytes: what is left of a 2 MiB second-level cache beside some rows of the image
FINEST_RATIO = 64  # offsets a voxel that a table keeps even beyond the cache: what packets have at a pixel a voxel
PASSING_RATIO = 16  # that it has at all if a picture is seen in passing: more take longer to make than they save
COARSEST_OFFSET_BITS = 3  # 8 offsets a pixel, which are kept even beyond the cache
LARGEST_TABLE = 1 << 25  # bytes: beyond, offsets give way
ROUNDING = 1e-6  # of a logarithm
LARGEST_HALF = 1 << 14  # pixels from the middle of one, which kernels count in 16 bits
LARGEST_SINGLE = 1 << 28  # of one offset: beyond, a footprint is larger than any image


@lru_cache(maxsize=16)
def kernel_projection(kernel: Kernel, radius: float) -> KernelProjection:
    """P(rho) of a kernel cut at `radius` voxels, computed in float64."""
    parameter = {Kernel.GAUSSIAN: GAUSSIAN_SIGMA, Kernel.KAISER_BESSEL: KAISER_BESSEL_ALPHA * radius}.get(kernel, 0.0)
    return KernelProjection(kernel.value, parameter, radius)


def offset_bits_for(shape: FootprintShape, in_passing: bool = False) -> int:
    """The binary logarithm of the offsets a pixel: 6 is the packets' own lattice.

    As fine as the cache allows, but across its narrow side a footprint never gets less than FINEST_RATIO offsets a
    voxel: where all samples of a sheet round alike, in axis-aligned views, coarser ones show. A precise one has all of
    them, unless that is more than anybody could hold; one of a picture that is seen in passing, while things move, no
    more than PASSING_RATIO.
    """
    ellipse = _ellipse(shape)
    mean, spread = (shape.qxx + shape.qyy) / 2, math.hypot((shape.qxx - shape.qyy) / 2, shape.qxy)
    narrow = 1 / math.sqrt(mean + spread)  # pixels a voxel
    ratio = PASSING_RATIO if in_passing else FINEST_RATIO
    enough = max(COARSEST_OFFSET_BITS, math.ceil(math.log2(ratio / narrow) - ROUNDING))
    if shape.precise:
        enough = SUBPIXEL_BITS
    bits = min(enough, SUBPIXEL_BITS) if in_passing else SUBPIXEL_BITS
    while bits > enough and FootprintTable.bytes_needed(ellipse, bits) > CACHE_BUDGET:
        bits -= 1
    while bits > 0 and FootprintTable.bytes_needed(ellipse, bits) > LARGEST_TABLE:
        bits -= 1
    return bits


@lru_cache(maxsize=2)
def footprint_table(shape: FootprintShape, threads: int = 1, in_passing: bool = False) -> FootprintTable:
    """The table of a view, made by so many threads. Raises BadInput where one footprint is larger than any image."""
    ellipse = _ellipse(shape)
    if max(shape.half_width, shape.half_height) >= LARGEST_HALF or (
        FootprintTable.bytes_needed(ellipse, 0) > LARGEST_SINGLE
    ):
        raise BadInput(
            f"a voxel's footprint is {2 * shape.half_width:.5g} x {2 * shape.half_height:.5g} pixels; lower the zoom, "
            f"or {CORRECT_SPACING}"
        )
    return FootprintTable(
        kernel_projection(shape.kernel, shape.radius), ellipse, offset_bits_for(shape, in_passing), threads
    )


def _ellipse(shape: FootprintShape) -> Ellipse:
    return Ellipse(shape.amplitude, shape.qxx, shape.qxy, shape.qyy, shape.half_width, shape.half_height)
