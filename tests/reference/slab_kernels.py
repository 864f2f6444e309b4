"""The kernels of step G, and how those with weights below 0 were found.

A wave of frequency w, sampled at all voxels and restored by a kernel K, is off by the mean over places
1 - 2 K(w) + sum over n of K(w + 2 pi n)^2, K(w) being the kernel's Fourier transform. The kernels are those of
(1 - q)^2 (c0 + c1 q + ...), q = (r / radius)^2, for which the sum of that over waves is least. The default one is a
mean of such a one and of a bell, (1 - q)^4.
"""

import math
from functools import cache

import torch
from torch import Tensor

from reference.footprint import kernel_density
from volsplat.protocol.description.scene import Kernel, SlabKernel
from volsplat.protocol.rules.slab_kernels import COEFFICIENTS, SLAB_RADIUS

POINTS = 401  # of a kernel over r
FALL, FALL_FROM = 6, 0.15  # of a wave's share: (frequency + from) to the power -fall
WAVES = 1500
ALIASES = 2  # of each, to either side on each axis
BELL_SHARE = 0.2  # of the default kernel


def slab_density(kernel: SlabKernel, r: Tensor) -> Tensor:
    """The kernel at distances within its radius (any shape), up to a constant factor."""
    radius = SLAB_RADIUS[kernel]
    if kernel not in COEFFICIENTS:
        return kernel_density(Kernel(kernel.value), r, radius)
    coefficients = torch.tensor(COEFFICIENTS[kernel], dtype=torch.float64)
    found: Tensor = (_shapes(r, radius, len(coefficients)) * coefficients).sum(dim=-1)
    return found


def coefficients_of(kernel: SlabKernel, radius: float, count: int) -> Tensor:
    """Those (count,) of a kernel with weights below 0, scaled so that it integrates to 1."""
    best = least_squares(radius, count)
    if kernel != SlabKernel.BALANCED:
        return best
    bell = torch.zeros(count, dtype=torch.float64)
    bell[:3] = torch.tensor([1.0, -2.0, 1.0])
    whole = _over_space(radius, count)[1].sum(dim=0) @ bell
    return (1 - BELL_SHARE) * best + BELL_SHARE * bell / whole


@cache
def least_squares(radius: float, count: int) -> Tensor:
    """The coefficients (count,), scaled so that the kernel integrates to 1."""
    r, shapes = _over_space(radius, count)
    # Powers of q are so alike that rounding alone would change their coefficients by a thousandth.
    orthogonal, powers = torch.linalg.qr(shapes)

    def transformed(frequency: Tensor) -> Tensor:
        found: Tensor = torch.sinc(frequency[:, None] * r / math.pi) @ orthogonal
        return found

    drawn = torch.Generator().manual_seed(1)
    directions = torch.randn((WAVES, 3), generator=drawn, dtype=torch.float64)
    size = math.pi * (torch.arange(WAVES, dtype=torch.float64) + 0.5) / WAVES
    waves = directions / directions.norm(dim=1, keepdim=True) * size[:, None]
    share = size**2 / (size + FALL_FROM) ** FALL
    axis = torch.arange(-ALIASES, ALIASES + 1, dtype=torch.float64)
    squares = torch.zeros((count, count), dtype=torch.float64)
    for alias in 2 * math.pi * torch.cartesian_prod(axis, axis, axis):
        found = transformed((waves + alias).norm(dim=1))
        squares += (found * share[:, None]).T @ found
    best = torch.linalg.solve(squares, (transformed(size) * share[:, None]).sum(dim=0))
    coefficients: Tensor = torch.linalg.solve(powers, best)
    return coefficients / (shapes.sum(dim=0) @ coefficients)


def _over_space(radius: float, count: int) -> tuple[Tensor, Tensor]:
    """Distances (n,), and what each shape has at each of them (n, count), by its share of space."""
    r = torch.linspace(0, radius, POINTS, dtype=torch.float64)
    spheres = 4 * math.pi * r**2 * radius / (POINTS - 1)
    spheres[-1] /= 2
    return r, _shapes(r, radius, count) * spheres[:, None]


def _shapes(r: Tensor, radius: float, count: int) -> Tensor:
    q = (r / radius) ** 2
    shapes = [torch.where(q < 1, (1 - q) ** 2, 0.0)]
    for _ in range(count - 1):
        shapes.append(shapes[-1] * q)
    return torch.stack(shapes, dim=-1)
