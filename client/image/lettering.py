"""Words on pictures, by OpenImageIO and the fonts that come with it."""

from functools import cache
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from volsplat.protocol.text.errors import VolsplatError

FONT, BOLD_FONT = "DroidSans", "DroidSans-Bold"


def canvas_of(image: NDArray[np.float32]) -> "oiio.ImageBuf":
    """A canvas of the image (H, W, channels), for OpenImageIO to write on."""
    height, width, channels = image.shape
    canvas = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    canvas.set_pixels(canvas.roi, image)
    return canvas


def pixels_of(canvas: "oiio.ImageBuf") -> NDArray[np.float32]:
    """What the canvas shows, (H, W, channels), 0..1."""
    pixels: NDArray[np.float32] | None = canvas.get_pixels(oiio.FLOAT)
    assert pixels is not None, canvas.geterror()
    return np.clip(pixels, 0.0, 1.0)


def extent(text: str, size: int, font: str) -> int:
    """The width of a text in pixels. Raises VolsplatError if the font is nowhere."""
    region = oiio.ImageBufAlgo.text_size(text, size, _found(font))
    if not region.defined:
        raise VolsplatError(
            f"cannot write on a picture: there is no font {font}; install OpenImageIO again, which brings it "
            "(pip install --force-reinstall openimageio), or leave out what is written"
        )
    return int(region.width)


def write(
    canvas: "oiio.ImageBuf", x: int, y: int, text: str, size: int, ink: float, font: str, room: int | None = None
) -> None:
    """Write a line with its base line at y, smaller where there is not room enough."""
    while room is not None and size > 8 and extent(text, size, font) > room:
        size -= 1
    if not oiio.ImageBufAlgo.render_text(canvas, x, y, text, size, _found(font), (ink, ink, ink)):
        raise VolsplatError(f"cannot write on a picture: {canvas.geterror()}")


@cache
def _found(font: str) -> str:
    """The file beside the library; by its name alone it is not found if $OpenImageIO_ROOT is another installation's."""
    file = Path(oiio.__file__).parent / "share/fonts/OpenImageIO" / f"{font}.ttf"
    return str(file) if file.is_file() else font
