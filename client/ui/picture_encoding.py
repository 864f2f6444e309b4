"""Images as the page receives them: the background under them, 8 bits, JPEG while they move and PNG when still."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from PIL import Image as PillowImage

from volsplat.client.published_image import PublishedImage
from volsplat.protocol.scene import Colour
from volsplat.splat_server._kernels import screen_levels

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
        quick = screen_levels(image.memory, background)  # as stored_levels, but rounded in float32
        picture = PillowImage.frombuffer("RGB", size, quick, "raw", "RGBX", 0, 1)
        picture.save(out, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    return out.getvalue()


def stored_levels(image: Tensor, background: Colour) -> Tensor:
    """(H, W, 3) uint8 as a saved PNG has them."""
    from volsplat.client.image_file import coded  # takes a while to import, and the first images are JPEG

    return coded(image, background, "uint8")
