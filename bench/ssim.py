"""How alike two pictures are: the structural similarity index of Wang, Bovik, Sheikh and Simoncelli (2004)."""

import torch
from torch import Tensor
from torch.nn.functional import conv2d

WINDOW = 11  # pixels
SIGMA = 1.5
STABLE = (0.01**2, 0.03**2)  # C1 and C2 for values 0..1
LUMINANCE = (0.2126, 0.7152, 0.0722)


def luminance(image: Tensor) -> Tensor:
    """(H, W) of an (H, W, 4) image with associated alpha, over black."""
    return image[..., :3].double() @ torch.tensor(LUMINANCE, dtype=torch.float64)


def ssim(one: Tensor, other: Tensor) -> float:
    """The mean index of two (H, W) pictures 0..1, at least 11 pixels a side; 1 for the same, at least -1."""
    one, other = one.double(), other.double()
    mean_one, mean_other = _blurred(one), _blurred(other)
    variance_one = _blurred(one * one) - mean_one**2
    variance_other = _blurred(other * other) - mean_other**2
    covariance = _blurred(one * other) - mean_one * mean_other
    c1, c2 = STABLE
    alike = (2 * mean_one * mean_other + c1) * (2 * covariance + c2)
    both = (mean_one**2 + mean_other**2 + c1) * (variance_one + variance_other + c2)
    return float((alike / both).mean())


def _blurred(picture: Tensor) -> Tensor:
    offset = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    weights = torch.exp(-(offset**2) / (2 * SIGMA**2))
    weights /= weights.sum()
    across = conv2d(picture[None, None], weights[None, None, None, :])
    return conv2d(across, weights[None, None, :, None])[0, 0]
