"""The kernels of step G that have weights below 0: the best of their kind, and no more over than servers count on."""

import math

import pytest
import torch
from torch import Tensor

from reference.footprint import integral
from reference.slab_kernels import least_squares, slab_density
from volsplat.protocol.description.scene import SlabKernel
from volsplat.protocol.rules.slab_kernels import COEFFICIENTS, OVERSHOOT, SLAB_RADIUS

SIGNED = sorted(COEFFICIENTS)
ROOM = {"below": 1.1, "above": 2.3}  # that sums have for weights below 0 and above it: splat_server's slab_sums.h
PLACES, WIDENINGS = 60, 24


@pytest.mark.parametrize("kernel", SIGNED)
def test_no_other_of_as_many_coefficients_restores_waves_better(kernel: SlabKernel) -> None:
    found = COEFFICIENTS[kernel]
    best = least_squares(SLAB_RADIUS[kernel], len(found))
    assert (best - torch.tensor(found, dtype=torch.float64)).abs().max() <= 1e-4


@pytest.mark.parametrize("kernel", SIGNED)
def test_it_does_not_overshoot_by_more_than_is_counted_on(kernel: SlabKernel) -> None:
    """On the grid, and widened across and in depth as far as a third of a pixel a voxel widens it."""
    drawn = torch.Generator().manual_seed(5)
    widenings = [torch.eye(3, dtype=torch.float64)]
    for n in range(WIDENINGS):
        axes = torch.linalg.qr(torch.randn((3, 3), generator=drawn, dtype=torch.float64)).Q
        lengths = 1 + 2 * torch.rand(3, generator=drawn, dtype=torch.float64) * torch.tensor([1, n % 2, n % 3 > 0])
        widenings.append(axes @ torch.diag(lengths) @ axes.T)
    for widening in widenings:
        places = torch.rand((PLACES, 3), generator=drawn, dtype=torch.float64)
        weights = weights_at(kernel, places, widening)
        below, all_of_them = weights.clamp(max=0).sum(dim=1).neg(), weights.sum(dim=1)
        assert (below / all_of_them).max() <= OVERSHOOT[kernel]
        assert below.max() <= ROOM["below"] and weights.clamp(min=0).sum(dim=1).max() <= ROOM["above"]


@pytest.mark.parametrize("kernel", SIGNED)
def test_what_is_even_stays_even_nearly_without_being_divided(kernel: SlabKernel) -> None:
    places = torch.rand((200, 3), generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    sums = weights_at(kernel, places, torch.eye(3, dtype=torch.float64)).sum(dim=1)
    assert (sums - 1).abs().max() <= 0.06


def weights_at(kernel: SlabKernel, places: Tensor, widening: Tensor) -> Tensor:
    """(n, m): of all voxels around each place of a cell."""
    radius = SLAB_RADIUS[kernel]
    far = math.ceil(radius * float(torch.linalg.matrix_norm(widening, 2))) + 1
    axis = torch.arange(-far, far + 1, dtype=torch.float64)
    off = (places[:, None] - torch.cartesian_prod(axis, axis, axis)) @ torch.linalg.inv(widening)
    r = off.norm(dim=-1)
    end = torch.tensor([radius], dtype=torch.float64)
    whole = integral(lambda at: 4 * math.pi * at**2 * slab_density(kernel, at), end) * torch.linalg.det(widening)
    found: Tensor = torch.where(r < radius, slab_density(kernel, r), 0.0) / whole
    return found
