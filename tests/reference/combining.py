"""Combining into the image buffer (paper: "Combining"), in both orders, sample by sample.

A buffer is (pixels, 4) float64: associated red, green, blue and alpha, 0..1.
"""

import numpy as np
import torch
from torch import Tensor

from volsplat.protocol.description.scene import Order

FROZEN_ALPHA = 1 - 1 / 1024  # design, section 4: front-to-back, a pixel at or above it changes no more


def weighted(weight: Tensor, opacity: Tensor) -> Tensor:
    """A_n = min(1, w A): the footprint's weight multiplies the opacity once."""
    return (weight * opacity).clamp(max=1.0)


def back_to_front(buffer: Tensor, opacity: Tensor, colour: Tensor) -> Tensor:
    """I_o = (1 - A_n) I_c + I_n A_n and A_o = (1 - A_n) A_c + A_n, for (m, 4), (m,), (m, 3)."""
    return _in_front(buffer, associated(opacity, colour))


def front_to_back(buffer: Tensor, opacity: Tensor, colour: Tensor) -> Tensor:
    """I_o = I_c + (1 - A_c) I_n A_n and A_o = A_c + (1 - A_c) A_n, unless the pixel is frozen."""
    return _behind(buffer, associated(opacity, colour))


def associated(opacity: Tensor, colour: Tensor) -> Tensor:
    """I_n A_n and A_n, (m, 4)."""
    return opacity[:, None] * torch.cat((colour, torch.ones_like(colour[:, :1])), dim=1)


def _in_front(buffer: Tensor, added: Tensor) -> Tensor:
    return (1 - added[:, 3:]) * buffer + added


def _behind(buffer: Tensor, added: Tensor) -> Tensor:
    combined = buffer + (1 - buffer[:, 3:]) * added
    return torch.where(buffer[:, 3:] >= FROZEN_ALPHA, buffer, combined)


def combine(order: Order, buffer: Tensor, pixel: Tensor, opacity: Tensor, colour: Tensor) -> None:
    """Put contributions into `buffer`: to pixel (m,) int64, A_n (m,) and I_n (m, 3), in traversal order.

    Pixels do not depend on each other: the n-th contributions of all pixels are combined at once. With the pixels
    that have most of them first, those that have an n-th one are always the first so many.
    """
    rule = _in_front if order == Order.BACK_TO_FRONT else _behind
    by_pixel = _stable_order(pixel)
    pixels, counts = torch.unique_consecutive(pixel[by_pixel], return_counts=True)
    most_first = torch.argsort(counts, descending=True)
    pixels, starts = pixels[most_first], (counts.cumsum(0) - counts)[most_first]
    turns = torch.bincount(counts).flip(0).cumsum(0).flip(0)[1:]  # how many pixels have an n-th contribution
    turn = torch.repeat_interleave(turns)
    of_pixel = torch.arange(len(pixel)) - (turns.cumsum(0) - turns)[turn]
    by_turn = by_pixel[starts[of_pixel] + turn]
    added = associated(opacity, colour).index_select(0, by_turn)
    combined = buffer[pixels]
    for part in torch.split(added, turns.tolist()):
        combined[: len(part)] = rule(combined[: len(part)], part)
    buffer[pixels] = combined


def _stable_order(pixel: Tensor) -> Tensor:
    """NumPy sorts numbers of 16 bits by their digits, many times as fast."""
    short = pixel.numpy().astype(np.uint16) if len(pixel) and int(pixel.max()) < 1 << 16 else pixel.numpy()
    return torch.from_numpy(np.argsort(short, kind="stable"))
