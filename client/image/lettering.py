"""Words on pictures, by OpenImageIO and the fonts that come with it."""

import OpenImageIO as oiio
from torch import Tensor

from volsplat.protocol.text.errors import VolsplatError

FONT, BOLD_FONT = "DroidSans", "DroidSans-Bold"


def canvas_of(image: Tensor) -> "oiio.ImageBuf":
    """A canvas of the image (H, W, channels), for OpenImageIO to write on."""
    height, width, channels = image.shape
    canvas = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    canvas.set_pixels(canvas.roi, image.contiguous().numpy())
    return canvas


def extent(text: str, size: int, font: str) -> int:
    """The width of a text in pixels."""
    return int(oiio.ImageBufAlgo.text_size(text, size, font).width)


def write(
    canvas: "oiio.ImageBuf", x: int, y: int, text: str, size: int, ink: float, font: str, room: int | None = None
) -> None:
    """Write a line with its base line at y, smaller where there is not room enough."""
    while room is not None and size > 8 and extent(text, size, font) > room:
        size -= 1
    if not oiio.ImageBufAlgo.render_text(canvas, x, y, text, size, font, (ink, ink, ink)):
        raise VolsplatError(f"cannot write on a picture: {canvas.geterror()}")
