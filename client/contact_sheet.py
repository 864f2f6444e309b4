"""The six images of successive refinement in one sheet, each with what it shows and how long it took."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import OpenImageIO as oiio
import torch
from torch import Tensor

from volsplat.client.image_file import over_background, write_pixels
from volsplat.protocol.errors import VolsplatError
from volsplat.protocol.scene import Colour, Step

COLUMNS = 3
LARGEST_SIDE = 640  # pixels of a picture in the sheet; larger ones are reduced
LEAST_WIDTH = 240  # of a cell, so that its caption fits
PAPER = 0.09  # grey of the sheet
INK, FAINT_INK = 0.95, 0.62
FONT, BOLD_FONT = "DroidSans", "DroidSans-Bold"  # both come with OpenImageIO

CAPTIONS = {
    Step.A: "every 4th sample",
    Step.B: "every 2nd sample",
    Step.C: "all samples",
    Step.D: "footprints",
    Step.E: "diffuse light",
    Step.F: "specular light",
}


class StepPicture(NamedTuple):
    step: Step
    image: Tensor  # (H, W, 4) float32, associated alpha; all of one size
    seconds: float


def write_contact_sheet(
    path: Path, pictures: Sequence[StepPicture], background: Colour = (0.0, 0.0, 0.0), title: str = ""
) -> None:
    """Write the pictures, three to a row, with captions. Raises BadInput where the file cannot be written."""
    write_pixels(path, contact_sheet(pictures, background, title))


def contact_sheet(pictures: Sequence[StepPicture], background: Colour = (0.0, 0.0, 0.0), title: str = "") -> Tensor:
    """The sheet as (H, W, 3) float32, 0..1."""
    images = [_reduced(over_background(picture.image, background)) for picture in pictures]
    height, width = max(i.shape[0] for i in images), max(i.shape[1] for i in images)
    cell = max(width, LEAST_WIDTH)
    text = max(round(cell / 20), 12)  # the captions' size
    gap, strip = text, round(text * 2.0)
    head = round(text * 3.2) if title else gap
    columns, rows = min(COLUMNS, len(images)), -(-len(images) // COLUMNS)
    sheet = torch.full((head + rows * (height + strip + gap), gap + columns * (cell + gap), 3), PAPER)
    corners = []
    for n, image in enumerate(images):
        left = gap + (n % COLUMNS) * (cell + gap)
        top = head + (n // COLUMNS) * (height + strip + gap)
        inset = left + (cell - image.shape[1]) // 2
        sheet[top : top + image.shape[0], inset : inset + image.shape[1]] = image
        corners.append((left, top + height))
    canvas = _buffer(sheet)
    if title:
        _write(canvas, gap, round(text * 2.2), title, round(text * 1.4), INK, FONT, room=sheet.shape[1] - 2 * gap)
    for (left, bottom), picture in zip(corners, pictures, strict=True):
        line = bottom + round(text * 1.35)
        seconds = _seconds(picture.seconds)
        taken = _extent(seconds, text, FONT)
        _write(canvas, left, line, picture.step.value, text, INK, BOLD_FONT)
        _write(canvas, left + round(text * 1.3), line, CAPTIONS[picture.step], text, INK, FONT)
        _write(canvas, left + cell - taken, line, seconds, text, FAINT_INK, FONT)
    return torch.from_numpy(canvas.get_pixels(oiio.FLOAT)).clamp(0.0, 1.0)


def _seconds(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"


def _reduced(image: Tensor) -> Tensor:
    """The image, no side longer than LARGEST_SIDE; averaged, never enlarged."""
    largest = max(image.shape[0], image.shape[1])
    if largest <= LARGEST_SIDE:
        return image
    factor = LARGEST_SIDE / largest
    size = (max(round(image.shape[0] * factor), 1), max(round(image.shape[1] * factor), 1))
    planes = image.permute(2, 0, 1).unsqueeze(0)
    return torch.nn.functional.interpolate(planes, size=size, mode="area")[0].permute(1, 2, 0)


def _buffer(image: Tensor) -> "oiio.ImageBuf":
    height, width, channels = image.shape
    canvas = oiio.ImageBuf(oiio.ImageSpec(width, height, channels, oiio.FLOAT))
    canvas.set_pixels(canvas.roi, image.contiguous().numpy())
    return canvas


def _extent(text: str, size: int, font: str) -> int:
    """The width of a text in pixels."""
    return int(oiio.ImageBufAlgo.text_size(text, size, font).width)


def _write(
    canvas: "oiio.ImageBuf", x: int, y: int, text: str, size: int, ink: float, font: str, room: int | None = None
) -> None:
    """Write a line with its base line at y, smaller where there is not room enough."""
    while room is not None and size > 8 and _extent(text, size, font) > room:
        size -= 1
    if not oiio.ImageBufAlgo.render_text(canvas, x, y, text, size, font, (ink, ink, ink)):
        raise VolsplatError(f"cannot write the captions of the contact sheet: {canvas.geterror()}")
