"""Images as the page receives them: the background under them, 8 bits, JPEG while they move and PNG when still."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from PIL import Image as PillowImage

from volsplat.protocol.scene import Colour

if TYPE_CHECKING:
    from torch import Tensor

JPEG_QUALITY = 85
PNG_EFFORT = 1  # 0 to 9; more costs time and hardly saves bytes


def encoded(image: Tensor, background: Colour, *, lossless: bool) -> bytes:
    """(H, W, 4) float32, associated, over the background: PNG with the very levels of a saved image, or JPEG."""
    out = io.BytesIO()
    if lossless:
        _picture(stored_levels(image, background), "RGB").save(out, "PNG", compress_level=PNG_EFFORT)
    else:
        _picture(_quick_levels(image, background), "RGBX").save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return out.getvalue()


def _picture(levels: Tensor, layout: str) -> PillowImage.Image:
    height, width, _ = levels.shape
    return PillowImage.frombuffer("RGB", (width, height), levels.contiguous().numpy(), "raw", layout, 0, 1)


def stored_levels(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 3) uint8 as a saved PNG has them."""
    from volsplat.client.image_file import coded  # takes a while to import, and the first images are JPEG

    return coded(image, background, "uint8")


def _quick_levels(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 4) uint8, colours as stored_levels but rounded in float32; the fourth is nothing, and quicker kept."""
    import torch

    if any(background):
        image = image + (1.0 - image[..., 3:]) * torch.tensor((*background, 0.0))
    return image.mul(255.0).add_(0.5).clamp_(0.0, 255.0).to(torch.uint8)
