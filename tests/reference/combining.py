"""Combining into the image buffer (paper: "Combining"), in both orders, sample by sample.

A buffer is (pixels, 4) float64: associated red, green, blue and alpha, 0..1.
"""

import torch
from torch import Tensor

from volsplat.protocol.description.scene import Order

FROZEN_ALPHA = 1 - 1 / 1024  # design, section 4: front-to-back, a pixel at or above it changes no more


def weighted(weight: Tensor, opacity: Tensor) -> Tensor:
    """A_n = min(1, w A): the footprint's weight multiplies the opacity once."""
    return (weight * opacity).clamp(max=1.0)


def back_to_front(buffer: Tensor, opacity: Tensor, colour: Tensor) -> Tensor:
    """I_o = (1 - A_n) I_c + I_n A_n and A_o = (1 - A_n) A_c + A_n, for (m, 4), (m,), (m, 3)."""
    a = opacity[:, None]
    return (1 - a) * buffer + a * _with_one(colour)


def front_to_back(buffer: Tensor, opacity: Tensor, colour: Tensor) -> Tensor:
    """I_o = I_c + (1 - A_c) I_n A_n and A_o = A_c + (1 - A_c) A_n, unless the pixel is frozen."""
    through = 1 - buffer[:, 3:]
    combined = buffer + through * (opacity[:, None] * _with_one(colour))
    return torch.where(buffer[:, 3:] >= FROZEN_ALPHA, buffer, combined)


def _with_one(colour: Tensor) -> Tensor:
    return torch.cat((colour, torch.ones_like(colour[:, :1])), dim=1)


def combine(order: Order, buffer: Tensor, pixel: Tensor, opacity: Tensor, colour: Tensor) -> None:
    """Put contributions into `buffer`: to pixel (m,) int64, A_n (m,) and I_n (m, 3), in traversal order.

    Pixels do not depend on each other: the n-th contributions of all pixels are combined at once.
    """
    rule = back_to_front if order == Order.BACK_TO_FRONT else front_to_back
    by_pixel = torch.argsort(pixel, stable=True)
    _, counts = torch.unique_consecutive(pixel[by_pixel], return_counts=True)
    starts = torch.repeat_interleave(counts.cumsum(0) - counts, counts)
    rank = torch.arange(len(pixel)) - starts
    by_rank = by_pixel[torch.argsort(rank, stable=True)]
    for turn in torch.split(by_rank, torch.bincount(rank).tolist()):
        buffer[pixel[turn]] = rule(buffer[pixel[turn]], opacity[turn], colour[turn])
