"""The footprint (paper: "Combining"): each kernel integrated along the view, on its ellipse on the screen.

P(rho) here is a quadrature of the kernel's definition; the ellipse comes from an eigen-decomposition. Neither
shares code with the splat server or with protocol/footprint_shape.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from volsplat.protocol.description.scene import Kernel, Reconstruction
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS, GAUSSIAN_SIGMA, KAISER_BESSEL_ALPHA

PROFILE_POINTS = 8193
QUADRATURE_POINTS = 96


def kernel_density(kernel: Kernel, r: Tensor, radius: float) -> Tensor:
    """h_V at distance r (any shape, float64, in voxels, r <= radius) from a sample, up to a constant factor."""
    match kernel:
        case Kernel.GAUSSIAN:
            return torch.exp(-(r**2) / (2 * GAUSSIAN_SIGMA**2))
        case Kernel.BSPLINE:
            t = 2 * r / radius
            inner = 2 / 3 - t**2 + t**3 / 2
            outer = (2 - t).clamp(min=0) ** 3 / 6
            return torch.where(t < 1, inner, outer)
        case Kernel.KAISER_BESSEL:
            u = (1 - (r / radius) ** 2).clamp(min=0).sqrt()
            return u**2 * _bessel_i2(KAISER_BESSEL_ALPHA * radius * u)
        case Kernel.CONE:
            return (1 - r / radius).clamp(min=0)


def _bessel_i2(x: Tensor) -> Tensor:
    """The modified Bessel function I_2 by its power series."""
    term = (x / 2) ** 2 / 2
    total = term.clone()
    for m in range(1, 60):
        term = term * (x / 2) ** 2 / (m * (m + 2))
        total = total + term
    return total


@functools.cache
def _gauss_legendre(points: int) -> tuple[Tensor, Tensor]:
    """Nodes and weights on 0..1, from the eigenvalues of the Jacobi matrix (Golub and Welsch 1969)."""
    n = torch.arange(1, points, dtype=torch.float64)
    off_diagonal = n / torch.sqrt(4 * n**2 - 1)
    nodes, vectors = torch.linalg.eigh(torch.diag(off_diagonal, 1) + torch.diag(off_diagonal, -1))
    return (nodes + 1) / 2, vectors[0] ** 2


def integral(f: Callable[[Tensor], Tensor], upper: Tensor) -> Tensor:
    """The integral of f from 0 to each of `upper` (n,)."""
    nodes, weights = _gauss_legendre(QUADRATURE_POINTS)
    return (f(upper[:, None] * nodes) * weights).sum(dim=1) * upper


@functools.cache
def _profile(kernel: Kernel, radius: float) -> Tensor:
    """P at rho = radius * cos(angle), for angles evenly from 0 to a right one (PROFILE_POINTS,)."""
    angle = torch.linspace(0, math.pi / 2, PROFILE_POINTS, dtype=torch.float64)
    rho_squared = (radius * angle.cos()) ** 2
    through = 2 * integral(
        lambda z: kernel_density(kernel, (rho_squared[:, None] + z**2).sqrt(), radius), radius * angle.sin()
    )
    whole = integral(
        lambda r: 4 * math.pi * r**2 * kernel_density(kernel, r, radius), torch.tensor([radius], dtype=torch.float64)
    )
    return through / whole


def projection(kernel: Kernel, radius: float, rho: Tensor) -> Tensor:
    """P(rho): the kernel of unit integral, cut at `radius`, integrated along a line at distance rho (any shape).

    Interpolated over the angle whose cosine is rho / radius, in which P is smooth at the middle and at the rim.
    """
    profile = _profile(kernel, radius)
    place = (rho / radius).clamp(max=1.0).acos() * ((PROFILE_POINTS - 1) / (math.pi / 2))
    below = place.floor().clamp(max=PROFILE_POINTS - 2).long()
    part = place - below
    return profile[below] * (1 - part) + profile[below + 1] * part


@dataclass(frozen=True)
class Footprint:
    """footprint(x, y) = amplitude * P(rho), rho^2 = (x, y) Q (x, y)^T."""

    kernel: Kernel
    radius: float
    amplitude: float
    inverse_ellipse: Tensor  # (2, 2) float64, Q
    half_size: tuple[float, float]  # of the bounding box along x and y, in pixels

    def weights(self, dx: Tensor, dy: Tensor) -> Tensor:
        """Weights at pixel offsets from the sample, x right and y DOWN (any shape)."""
        q = self.inverse_ellipse
        rho = (q[0, 0] * dx**2 + 2 * q[0, 1] * dx * dy + q[1, 1] * dy**2).clamp(min=0).sqrt()
        return self.amplitude * projection(self.kernel, self.radius, rho)


def footprint_of(steps: Tensor, zoom: float, strides: Index | int, reconstruction: Reconstruction) -> Footprint:
    """The footprint for `steps` (3, 3), columns in pixels for a step of i, j, k with y UP (mapping.steps_on_screen).

    Every so many voxels along i, j and k are visited. The unit ball becomes an ellipse with the matrix D D^T on the
    screen; its axes are widened to one pixel.
    """
    upside_down = torch.tensor([[1.0], [-1.0]], dtype=torch.float64)
    on_axes = torch.tensor(strides, dtype=torch.float64).expand(3)
    flat = steps[:2] * upside_down * on_axes
    squares, axes = torch.linalg.eigh(flat @ flat.T)
    squares = squares.clamp(min=1.0)
    ellipse = axes @ torch.diag(squares) @ axes.T
    radius = reconstruction.radius
    if radius == "default":
        radius = DEFAULT_RADIUS[reconstruction.kernel]
    return Footprint(
        kernel=reconstruction.kernel,
        radius=radius,
        amplitude=zoom**2 * float(on_axes.prod()) ** (2 / 3) / float(squares.prod().sqrt()),
        inverse_ellipse=axes @ torch.diag(1 / squares) @ axes.T,
        half_size=(radius * math.sqrt(float(ellipse[0, 0])), radius * math.sqrt(float(ellipse[1, 1]))),
    )
