"""Builds the footprint table of a view, as fine as the cache allows (paper: "Combining"; design, section 3.6)."""

from functools import lru_cache

from volsplat.protocol.errors import BadInput
from volsplat.protocol.footprint_shape import GAUSSIAN_SIGMA, KAISER_BESSEL_ALPHA, FootprintShape
from volsplat.protocol.packet_layout import SUBPIXEL_BITS
from volsplat.protocol.scene import Kernel
from volsplat.splat_server._kernels import Ellipse, FootprintTable, KernelProjection

CACHE_BUDGET = 1 << 20  # bytes: half of a common L2 cache, since the image's rows want the other half
COARSEST_OFFSET_BITS = 3  # 8 offsets a pixel, unless the table would leave LARGEST_TABLE
LARGEST_TABLE = 1 << 25
LARGEST_SINGLE = 1 << 28  # of one offset: beyond, a footprint is larger than any image


@lru_cache(maxsize=16)
def kernel_projection(kernel: Kernel, radius: float) -> KernelProjection:
    """P(rho) of a kernel cut at `radius` voxels, computed in float64."""
    parameter = {Kernel.GAUSSIAN: GAUSSIAN_SIGMA, Kernel.KAISER_BESSEL: KAISER_BESSEL_ALPHA * radius}.get(kernel, 0.0)
    return KernelProjection(kernel.value, parameter, radius)


def offset_bits_for(ellipse: Ellipse) -> int:
    """The binary logarithm of the offsets a pixel: 6 is the packets' own lattice."""
    bits = SUBPIXEL_BITS
    while bits > COARSEST_OFFSET_BITS and FootprintTable.bytes_needed(ellipse, bits) > CACHE_BUDGET:
        bits -= 1
    while bits > 0 and FootprintTable.bytes_needed(ellipse, bits) > LARGEST_TABLE:
        bits -= 1
    return bits


@lru_cache(maxsize=2)
def footprint_table(shape: FootprintShape) -> FootprintTable:
    """The table of a view. Raises BadInput where one footprint is larger than any image."""
    ellipse = Ellipse(shape.amplitude, shape.qxx, shape.qxy, shape.qyy, shape.half_width, shape.half_height)
    if FootprintTable.bytes_needed(ellipse, 0) > LARGEST_SINGLE:
        raise BadInput(
            f"a voxel's footprint is {2 * shape.half_width:.0f} x {2 * shape.half_height:.0f} pixels; lower the zoom"
        )
    return FootprintTable(kernel_projection(shape.kernel, shape.radius), ellipse, offset_bits_for(ellipse))
