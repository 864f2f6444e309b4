"""The ellipse of a frame's footprint on the screen (paper: "Combining"; widening after Zwicker 2001).

A radially symmetric kernel K in index space, carried to the screen by the 3x3 matrix D and integrated along z,
is an elliptical function w(x, y) = amplitude * P(rho), rho^2 = (x, y) Q (x, y)^T, with P the projection of K
scaled to integrate to 1 over the plane. Q is the inverse of the upper 2x2 block of D D^T.
"""

import math
from functools import lru_cache

import msgspec

from volsplat.protocol.description.scene import Kernel, Reconstruction
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.matrices import Vector, dot
from volsplat.protocol.rules.grid_on_screen import GridOnScreen
from volsplat.protocol.rules.traversal import mean_stride

# Radial kernels K(r) of the design's section 4, r in voxels, each zero from its radius R on:
#   gaussian       exp(-r^2 / (2 sigma^2)), cut at R
#   bspline        B(2 r / R), B the cubic B-spline: 2/3 - t^2 + t^3/2 below 1, (2 - t)^3/6 below 2
#   kaiser-bessel  q^2 I2(5.2 R q), q = sqrt(1 - (r / R)^2), I2 the modified Bessel function (Lewitt 1990)
#   cone           1 - r / R
# P(rho) is the integral of K(sqrt(rho^2 + z^2)) over z, divided by the integral of K over space.

GAUSSIAN_SIGMA = 0.62  # voxels: cut at 2 voxels, sums of exact weights are even within 0.65 % at any zoom
KAISER_BESSEL_ALPHA = 5.2  # per voxel of radius: the usual 10.4 at 2 voxels

# Where each kernel is cut unless the scene says otherwise, in voxels. At 2, a zoom of 2 means 8 x 8 pixels.
DEFAULT_RADIUS = {
    Kernel.GAUSSIAN: 2.0,
    Kernel.BSPLINE: 2.0,
    Kernel.KAISER_BESSEL: 2.0,
    Kernel.CONE: 2.0,
}

# How far, at the default radius, the weights over a pixel may be from thickness / reference spacing, as a fraction,
# over all views, zooms and matrices, in one sheet with exact positions. The cone's and the B-spline's worst is below
# one pixel a voxel. In axis-aligned views all samples of one sheet round alike, by up to 2 % at about one pixel a
# voxel; over sheets that cancels (see rounding): a slab ripples by 1 % at most, rounding included.
DOCUMENTED_RIPPLE = {
    Kernel.GAUSSIAN: 0.01,
    Kernel.BSPLINE: 0.005,
    Kernel.KAISER_BESSEL: 0.003,
    Kernel.CONE: 0.025,
}


ROUND_WITHIN = 1e-9  # relative: far above rounding errors, far below what shows

GREATEST_COEFFICIENT = 1e6  # of the ellipse: 1 where it is widened to the pixel
CORRECT_SPACING = "correct the volume's spacing if its voxels are not as long as that (`volsplat info` shows it)"
GREATEST_AMPLITUDE = 1e30  # float32 computes with it


class FootprintShape(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Weights are amplitude * P(sqrt(qxx x^2 + 2 qxy x y + qyy y^2)), x and y in pixels, zero beyond `radius`."""

    kernel: Kernel
    radius: float  # in voxels, the units of rho
    amplitude: float
    qxx: float
    qxy: float
    qyy: float
    half_width: float  # of the ellipse's bounding box, in pixels
    half_height: float
    precise: bool = False  # at all offsets that positions have, though that be slower

    def __post_init__(self) -> None:
        _check_radius(self.radius)
        if not (0 < min(self.qxx, self.qyy) and max(self.qxx, self.qyy, abs(self.qxy)) <= GREATEST_COEFFICIENT):
            raise ValueError(f"a footprint must be an ellipse, not of {self.qxx}, {self.qxy} and {self.qyy}")
        if not (0 < self.half_width < math.inf and 0 < self.half_height < math.inf):
            raise ValueError(f"a footprint has a finite size, not {self.half_width} x {self.half_height} pixels")
        if not 0 <= self.amplitude <= GREATEST_AMPLITUDE:
            raise ValueError(f"a footprint's amplitude must be 0 to {GREATEST_AMPLITUDE:g}, not {self.amplitude}")

    def mirrored(self) -> "FootprintShape":
        """With x and y exchanged."""
        return msgspec.structs.replace(
            self, qxx=self.qyy, qyy=self.qxx, half_width=self.half_height, half_height=self.half_width
        )


@lru_cache(8)  # each frame brings the same one
def _check_radius(radius: float) -> None:
    Reconstruction(radius=radius)


def kernel_radius(reconstruction: Reconstruction) -> float:
    """Where the kernel is cut, in voxels."""
    return DEFAULT_RADIUS[reconstruction.kernel] if reconstruction.radius == "default" else reconstruction.radius


def footprint_shape(grid: GridOnScreen, strides: Index | int, reconstruction: Reconstruction) -> FootprintShape:
    """The footprint where every so many voxels along i, j and k are visited, or as many on each axis.

    The kernel is as much longer there. Its weights over all pixels sum to (zoom * s)^2, s being the strides' mean.

    An axis of the ellipse below one pixel a voxel is widened to one, the sum kept, so that nothing aliases.
    Raises ValueError where it is of no size that can be computed with.
    """
    strides = (strides, strides, strides) if isinstance(strides, int) else strides
    across, down = (_stretched(row, strides) for row in grid.pixels_per_index[:2])
    s = mean_stride(strides)
    vxx, vxy, vyy = dot(across, across), dot(across, down), dot(down, down)
    vxx, vxy, vyy = widened(*_rounded_if_round(vxx, vxy, vyy, (grid.zoom * s) ** 2))
    area = vxx * vyy - vxy * vxy
    radius = kernel_radius(reconstruction)
    return FootprintShape(
        kernel=reconstruction.kernel,
        radius=radius,
        amplitude=(grid.zoom * s) ** 2 / math.sqrt(area),
        qxx=vyy / area,
        qxy=-vxy / area,
        qyy=vxx / area,
        half_width=radius * math.sqrt(vxx),
        half_height=radius * math.sqrt(vyy),
        precise=reconstruction.precise,
    )


def _stretched(row: Vector, strides: Index) -> Vector:
    i, j, k = (step * stride for step, stride in zip(row, strides, strict=True))
    return (i, j, k)


def _rounded_if_round(vxx: float, vxy: float, vyy: float, square: float) -> tuple[float, float, float]:
    """The matrix, without the rounding errors of the view where the kernel is rotationally symmetric.

    Then the footprint is the same from every side (paper: "Combining"), and one table serves all views.
    """
    error = max(abs(vxx - square), abs(vxy), abs(vyy - square))
    return (square, 0.0, square) if error <= ROUND_WITHIN * square else (vxx, vxy, vyy)


def widened(vxx: float, vxy: float, vyy: float) -> tuple[float, float, float]:
    """The symmetric 2x2 matrix of vxx, vxy and vyy with its eigenvalues raised to at least 1."""
    mean, spread = (vxx + vyy) / 2, math.sqrt(((vxx - vyy) / 2) ** 2 + vxy * vxy)
    large, small = mean + spread, mean - spread
    if small >= 1.0:
        return vxx, vxy, vyy
    if large <= 1.0 or spread == 0.0:
        return max(large, 1.0), 0.0, max(large, 1.0)
    # V = small I + (large - small) n n^T, with n n^T = (V - small I) / (large - small).
    gain = (large - 1.0) / (large - small)
    return 1.0 + (vxx - small) * gain, vxy * gain, 1.0 + (vyy - small) * gain
