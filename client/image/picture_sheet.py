"""Pictures side by side in one image, each with a caption."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from volsplat.client.image.lettering import BOLD_FONT, FONT, canvas_of, extent, pixels_of, write

LARGEST_SIDE = 640  # pixels of a picture in the sheet; larger ones are reduced
LEAST_WIDTH = 320  # of a cell, so that what is written below a picture fits beside its legend
PAPER = 0.09  # grey of the sheet
INK, FAINT_INK = 0.95, 0.62


Pixels = NDArray[np.float32]


class SheetPicture(NamedTuple):
    pixels: Pixels  # (H, W, 3) float32, 0..1
    mark: str  # one letter, in bold before the caption; or nothing
    caption: str
    aside: str = ""  # faint, at the caption's right
    note: str = ""  # faint, below the caption
    legend: Callable[[int, float], Pixels] | None = None  # (N, N, 3) for a side of N pixels on a grey, at the right


def picture_sheet(pictures: Sequence[SheetPicture], columns: int, title: str = "") -> Pixels:
    """The sheet as (H, W, 3) float32, 0..1, with so many pictures in a row."""
    images = [_reduced(picture.pixels) for picture in pictures]
    height, width = max(i.shape[0] for i in images), max(i.shape[1] for i in images)
    cell = max(width, LEAST_WIDTH)
    text = max(round(cell / 20), 12)  # the captions' size
    gap, strip = text, round(text * (3.3 if any(picture.note for picture in pictures) else 2.0))
    head = round(text * 3.2) if title else gap
    columns, rows = min(columns, len(images)), -(-len(images) // columns)
    sheet = np.full((head + rows * (height + strip + gap), gap + columns * (cell + gap), 3), PAPER, np.float32)
    corners = []
    for n, image in enumerate(images):
        left = gap + (n % columns) * (cell + gap)
        top = head + (n // columns) * (height + strip + gap)
        inset = left + (cell - image.shape[1]) // 2
        sheet[top : top + image.shape[0], inset : inset + image.shape[1]] = image
        if legend := pictures[n].legend:
            right, below = left + cell, top + height
            sheet[below : below + strip, right - strip : right] = legend(strip, PAPER)
        corners.append((left, top + height))
    canvas = canvas_of(sheet)
    if title:
        write(canvas, gap, round(text * 2.2), title, round(text * 1.4), INK, FONT, room=sheet.shape[1] - 2 * gap)
    for (left, bottom), picture in zip(corners, pictures, strict=True):
        room = cell if picture.legend is None else cell - strip
        _write_caption(canvas, left, bottom, room, text, picture)
    return pixels_of(canvas)


def _write_caption(
    canvas: "oiio.ImageBuf", left: int, bottom: int, cell: int, text: int, picture: SheetPicture
) -> None:
    line = bottom + round(text * 1.35)
    taken = extent(picture.aside, text, FONT) if picture.aside else 0
    indent = round(text * 1.3) if picture.mark else 0
    if picture.mark:
        write(canvas, left, line, picture.mark, text, INK, BOLD_FONT)
    write(canvas, left + indent, line, picture.caption, text, INK, FONT, room=cell - indent - taken)
    if picture.aside:
        write(canvas, left + cell - taken, line, picture.aside, text, FAINT_INK, FONT)
    if picture.note:
        below = line + round(text * 1.3)
        write(canvas, left + indent, below, picture.note, round(text * 0.85), FAINT_INK, FONT, room=cell - indent)


def _reduced(image: Pixels) -> Pixels:
    """The image, no side longer than LARGEST_SIDE; averaged, never enlarged."""
    largest = max(image.shape[0], image.shape[1])
    if largest <= LARGEST_SIDE:
        return image
    factor = LARGEST_SIDE / largest
    (top, tall), (left, wide) = (_windows(side, max(round(side * factor), 1)) for side in image.shape[:2])
    total = np.zeros((len(top), len(left), image.shape[2]), np.float32)
    for down, right in np.ndindex(tall.max(), wide.max()):
        inside = (down < tall)[:, None, None] & (right < wide)[:, None]
        values = image[np.ix_((top + down) % image.shape[0], (left + right) % image.shape[1])]
        np.add(total, values, out=total, where=inside)
    total /= tall.astype(np.float32)[:, None, None]
    total /= wide.astype(np.float32)[:, None]
    return total


def _windows(side: int, fewer: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Of so many pixels instead of `side`: the first one that each takes part of, and how many."""
    pixel = np.arange(fewer)
    first = pixel * side // fewer
    return first, -(-(pixel + 1) * side // fewer) - first
