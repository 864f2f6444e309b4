"""The structural similarity index, by its own properties and by the formula in one window."""

import torch
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ROUNDING
from volsplat.bench.ssim import LUMINANCE, SIGMA, STABLE, WINDOW, luminance, ssim


def picture(seed: int, size: int = 40) -> torch.Tensor:
    return torch.rand((size, size), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


@given(st.integers(0, 99), st.integers(0, 99))
def test_it_is_symmetric_and_at_most_1_which_only_the_same_picture_reaches(a: int, b: int) -> None:
    one, other = picture(a), picture(b)
    assert abs(ssim(one, other) - ssim(other, one)) < ROUNDING
    assert abs(ssim(one, one) - 1) < ROUNDING
    assert a == b or -1 <= ssim(one, other) < 1 - ROUNDING


@given(st.integers(0, 99))
def test_more_noise_is_less_alike(seed: int) -> None:
    clean, noise = picture(seed), picture(seed + 1000) - 0.5
    likeness = [ssim(clean, clean + share * noise) for share in (0.0, 0.1, 0.3, 1.0)]
    assert likeness == sorted(likeness, reverse=True)


@given(st.integers(0, 99))
def test_a_negative_is_unlike(seed: int) -> None:
    one = picture(seed)
    assert ssim(one, 1 - one) < 0


def test_it_is_the_formula_in_a_single_window() -> None:
    one, other = picture(1, WINDOW), picture(2, WINDOW)
    offset = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    line = torch.exp(-(offset**2) / (2 * SIGMA**2))
    weight = line[:, None] * line / line.sum() ** 2
    a, b = (weight * one).sum(), (weight * other).sum()
    va, vb = (weight * (one - a) ** 2).sum(), (weight * (other - b) ** 2).sum()
    cov = (weight * (one - a) * (other - b)).sum()
    c1, c2 = STABLE
    expected = (2 * a * b + c1) * (2 * cov + c2) / ((a * a + b * b + c1) * (va + vb + c2))
    assert abs(ssim(one, other) - float(expected)) < ROUNDING


def test_luminance_is_over_black_and_of_white_is_1() -> None:
    assert abs(sum(LUMINANCE) - 1) < ROUNDING
    image = torch.tensor([[[0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 0.0, 1.0]]])
    assert torch.allclose(luminance(image), torch.tensor([[0.5, 0.0]], dtype=torch.float64))
