"""Images as the page receives them: the background under them, 8 bits, JPEG while they move and PNG when still."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, cast

from PIL import Image as PillowImage

from volsplat.client.session.published_image import PublishedImage
from volsplat.protocol.description.scene import Colour

if TYPE_CHECKING:
    from torch import Tensor

JPEG_QUALITY = 85
PNG_EFFORT = 1  # 0 to 9; more costs time and hardly saves bytes


def encoded(image: PublishedImage, background: Colour, *, lossless: bool) -> bytes:
    """An image over the background: PNG with the very levels of a saved image, or JPEG."""
    size, out = (image.width, image.height), io.BytesIO()
    if lossless:
        levels = stored_levels(image.tensor, background).contiguous().numpy()
        picture = PillowImage.frombuffer("RGB", size, levels, "raw", "RGB", 0, 1)
        picture.save(out, "PNG", compress_level=PNG_EFFORT)
    else:
        picture = PillowImage.frombuffer("RGB", size, screen_levels(image, background), "raw", "RGBX", 0, 1)
        picture.save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return out.getvalue()


def stored_levels(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 3) uint8 as a saved PNG has them."""
    from volsplat.client.image.image_file import coded  # takes a while to import, and the first images are JPEG

    return coded(image, background, "uint8")


def screen_levels(image: PublishedImage, background: Colour) -> bytes:
    """Red, green, blue and nothing for each pixel, 8 bits, as stored_levels but rounded in float32.

    Over black by Pillow alone, for which each channel of each pixel is one of a grey image: a first picture should not
    wait for torch.
    """
    if any(background):
        import torch

        shown = image.tensor + (1.0 - image.tensor[..., 3:]) * torch.tensor((*background, 0.0))
        image = PublishedImage.of(shown)
    memory = cast(bytearray, image.memory)  # any buffer will do
    channels = PillowImage.frombuffer("F", (4 * image.width, image.height), memory, "raw", "F", 0, 1)
    return channels.point(lambda value: value * 255.0 + 0.5).convert("L").tobytes()
