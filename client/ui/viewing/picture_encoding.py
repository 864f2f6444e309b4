"""Images as the page receives them: the background under them, 8 bits, JPEG while they move and PNG when still."""

from __future__ import annotations

import io
from typing import cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from volsplat.client.image.image_file import coded
from volsplat.client.session.published_image import PublishedImage
from volsplat.protocol.description.colours import Colour

JPEG_QUALITY = 85
ENLARGED_JPEG_QUALITY = 95  # of what is shown larger, blocks and all
LARGEST_PREVIEW = 768  # pixels a side
PNG_EFFORT = 1  # 0 to 9; more costs time and hardly saves bytes


def encoded(image: PublishedImage, background: Colour, *, lossless: bool, enlarged: bool = False) -> bytes:
    """An image over the background: PNG with the very levels of a saved image, or JPEG, finer if it is `enlarged`."""
    size, out = (image.width, image.height), io.BytesIO()
    if lossless:
        picture = PillowImage.frombuffer("RGB", size, coded(image.pixels, background), "raw", "RGB", 0, 1)
        picture.save(out, "PNG", compress_level=PNG_EFFORT)
    else:
        picture = PillowImage.frombuffer("RGB", size, screen_levels(image, background), "raw", "RGBX", 0, 1)
        quality = ENLARGED_JPEG_QUALITY if enlarged else JPEG_QUALITY
        picture.save(out, "JPEG", quality=quality, subsampling=0)
    return out.getvalue()


def preview(image: PublishedImage, background: Colour) -> bytes:
    """A JPEG of it, scaled down to what a page can hold beside all else."""
    size, out = (image.width, image.height), io.BytesIO()
    picture = PillowImage.frombuffer("RGB", size, screen_levels(image, background), "raw", "RGBX", 0, 1)
    picture.thumbnail((LARGEST_PREVIEW, LARGEST_PREVIEW))
    picture.save(out, "JPEG", quality=JPEG_QUALITY)
    return out.getvalue()


def png_of(levels: NDArray[np.uint8]) -> bytes:
    """(rows, columns, 4) as they are: red, green, blue and opacity."""
    out = io.BytesIO()
    PillowImage.fromarray(levels, "RGBA").save(out, "PNG", compress_level=PNG_EFFORT)
    return out.getvalue()


def screen_levels(image: PublishedImage, background: Colour) -> bytes:
    """Red, green, blue and nothing for each pixel, 8 bits, as a saved image but rounded in float32.

    By Pillow, for which each channel of each pixel is one of a grey image, and which is faster at it than numpy.
    """
    if any(background):
        shown = image.pixels + (1.0 - image.pixels[..., 3:]) * np.array((*background, 0.0), np.float32)
        image = PublishedImage.of(shown)
    memory = cast(bytearray, image.memory)  # any buffer will do
    channels = PillowImage.frombuffer("F", (4 * image.width, image.height), memory, "raw", "F", 0, 1)
    return channels.point(lambda value: value * 255.0 + 0.5).convert("L").tobytes()
