"""The kernels of step G that have weights below 0: the best of their kind, and no more over than servers count on."""

import math

import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from torch import Tensor

from reference.footprint import integral
from reference.slab_kernels import coefficients_of, slab_density
from volsplat.protocol.description.scene import Reconstruction, SlabKernel
from volsplat.protocol.rules.slab_kernels import COEFFICIENTS, INNER_RADIUS, LEAST_KNOWN, OVERSHOOT, SLAB_RADIUS

SIGNED = sorted(COEFFICIENTS)
ROOM = {"below": 1.1, "above": 2.3}  # that sums have for weights below 0 and above it: splat_server's slab_sums.h
PLACES = 60

signed = st.sampled_from(SIGNED)
seeds = st.integers(0, 1 << 30)
widenings = st.tuples(*[st.floats(1.0, 3.0)] * 3)  # as far as a third of a pixel a voxel widens across, and in depth


@pytest.mark.parametrize("kernel", SIGNED)
def test_its_coefficients_are_those_that_restore_waves_best(kernel: SlabKernel) -> None:
    found = COEFFICIENTS[kernel]
    best = coefficients_of(kernel, SLAB_RADIUS[kernel], len(found))
    assert (best - torch.tensor(found, dtype=torch.float64)).abs().max() <= 0.51e-4  # four decimals are kept


@given(signed, widenings, seeds)
@example(SlabKernel.BALANCED, (1.0, 1.0, 1.0), 5)
def test_densities_stay_within_what_is_counted_on(
    kernel: SlabKernel, lengths: tuple[float, float, float], seed: int
) -> None:
    """Of any densities around, also where some voxels have no data: the inner ones', and a share of the way beyond."""
    drawn = torch.Generator().manual_seed(seed)
    weights, inner = weights_around(kernel, lengths, drawn)
    assert weights.clamp(max=0).sum(dim=1).neg().max() <= ROOM["below"]
    assert weights.clamp(min=0).sum(dim=1).max() <= ROOM["above"]
    density = 255 * torch.rand(weights.shape, generator=drawn, dtype=torch.float64)
    density = torch.where(weights < 0, density * torch.rand((), generator=drawn), density)  # adverse ones
    for share, known in ((1.0, torch.ones_like(weights)), (LEAST_KNOWN[kernel], half_away(weights, drawn))):
        sums = (known * weights).sum(dim=1)
        reached = known * (weights != 0) > 0
        has, near = sums >= min(share, 0.9), reached & inner
        found = ((known * weights * density).sum(dim=1) / sums)[has]
        least, greatest = extremes(density, reached, has)
        low, high = extremes(density, near, has)
        by = OVERSHOOT[kernel] / share
        assert (found <= high + by * (high - least) + 1e-9).all()
        assert (found >= low - by * (greatest - low) - 1e-9).all()


@given(signed, widenings, seeds)
@example(SlabKernel.BALANCED, (1.0, 1.0, 1.0), 5)
def test_it_does_not_overshoot_by_more_than_is_counted_on(
    kernel: SlabKernel, lengths: tuple[float, float, float], seed: int
) -> None:
    weights, inner = weights_around(kernel, lengths, torch.Generator().manual_seed(seed))
    assert (weights[~inner] <= 0).all()
    below, all_of_them = weights.clamp(max=0).sum(dim=1).neg(), weights.sum(dim=1)
    assert (below / all_of_them).max() <= OVERSHOOT[kernel]


def test_the_default_overshoots_less_than_the_sharper_ones() -> None:
    default = Reconstruction().slab_kernel
    assert default == SlabKernel.BALANCED and 0 < OVERSHOOT[default] <= 0.4 < OVERSHOOT[SlabKernel.CRISP]


@given(signed, seeds)
def test_what_is_even_stays_even_nearly_without_being_divided(kernel: SlabKernel, seed: int) -> None:
    weights, _ = weights_around(kernel, (1.0, 1.0, 1.0), torch.Generator().manual_seed(seed))
    assert (weights.sum(dim=1) - 1).abs().max() <= 0.06


def half_away(weights: Tensor, drawn: torch.Generator) -> Tensor:
    """1 where voxels have data: half of them, and more of those whose weights are below 0."""
    return (torch.rand(weights.shape, generator=drawn) < torch.where(weights < 0, 0.9, 0.5)).double()


def extremes(density: Tensor, of: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
    least = torch.where(of, density, math.inf).amin(dim=1)[rows]
    return least, torch.where(of, density, -math.inf).amax(dim=1)[rows]


def weights_around(
    kernel: SlabKernel, lengths: tuple[float, float, float], drawn: torch.Generator
) -> tuple[Tensor, Tensor]:
    """(n, m): of all voxels around each place of a cell, and which of them are inner ones; the kernel is widened."""
    axes = torch.linalg.qr(torch.randn((3, 3), generator=drawn, dtype=torch.float64)).Q
    widening = axes @ torch.diag(torch.tensor(lengths, dtype=torch.float64)) @ axes.T
    places = torch.rand((PLACES, 3), generator=drawn, dtype=torch.float64)
    radius = SLAB_RADIUS[kernel]
    far = math.ceil(radius * max(lengths)) + 1
    axis = torch.arange(-far, far + 1, dtype=torch.float64)
    off = (places[:, None] - torch.cartesian_prod(axis, axis, axis)) @ torch.linalg.inv(widening)
    r = off.norm(dim=-1)
    end = torch.tensor([radius], dtype=torch.float64)
    whole = integral(lambda at: 4 * math.pi * at**2 * slab_density(kernel, at), end) * torch.linalg.det(widening)
    return torch.where(r < radius, slab_density(kernel, r), 0.0) / whole, r < INNER_RADIUS[kernel]
