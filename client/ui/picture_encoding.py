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
    levels = stored_levels(image, background) if lossless else _quick_levels(image, background)
    height, width, _ = levels.shape
    picture = PillowImage.frombuffer("RGB", (width, height), levels.contiguous().numpy().tobytes(), "raw", "RGB", 0, 1)
    out = io.BytesIO()
    if lossless:
        picture.save(out, "PNG", compress_level=PNG_EFFORT)
    else:
        picture.save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return out.getvalue()


def stored_levels(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 3) uint8 as a saved PNG has them."""
    from volsplat.client.image_file import coded  # takes a while to import, and the first images are JPEG

    return coded(image, background, "uint8")


def _quick_levels(image: Tensor, background: Colour) -> Tensor:
    """As stored_levels, rounded in float32."""
    import torch

    colour = image[..., :3]
    if any(background):
        colour = colour + (1.0 - image[..., 3:]) * torch.tensor(background)
    return colour.mul(255.0).add_(0.5).clamp_(0.0, 255.0).to(torch.uint8)
