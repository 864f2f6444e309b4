"""A drawing as pixels. Where nothing is drawn over the picture, its numbers are what they were."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.client.figure.drawing import Anchor, Area, Box, Drawing, Line, Ramp, Shape, Words
from volsplat.client.figure.type_faces import advance, runs_of, width_of
from volsplat.client.image.lettering import canvas_of, pixels_of, write
from volsplat.protocol.description.colours import Colour

REMEMBERED = 256  # lines of text
HALO = 0.12  # of the words' size, but at least a pixel

Pixels = NDArray[np.float32]


def painted(drawing: Drawing) -> Pixels:
    """(H, W, 4) float32, associated alpha, without the background, as a plain image is."""
    pixels = np.zeros((drawing.height, drawing.width, 4), np.float32)
    x, y = drawing.corner
    height, width, _ = drawing.picture.shape
    pixels[y : y + height, x : x + width] = drawing.picture
    for shape in drawing.shapes:
        _paint(pixels, shape)
    return pixels


def _paint(pixels: Pixels, shape: Shape) -> None:
    match shape:
        case Words():
            _paint_words(pixels, shape)
        case Line():
            _paint_line(pixels, shape)
        case Box(x, y, width, height, colour):
            left, top = round(x), round(y)
            _put(pixels, left, top, np.ones((round(y + height) - top, round(x + width) - left), np.float32), colour)
        case Ramp():
            _paint_ramp(pixels, shape)
        case Area():
            _paint_area(pixels, shape)


def _put(pixels: Pixels, left: int, top: int, cover: Pixels, colour: Colour | Pixels) -> None:
    """Lay a colour over the pixels by its coverage (h, w), clipped to them; what is not covered is left as it is."""
    height, width = pixels.shape[:2]
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + cover.shape[1], width), min(top + cover.shape[0], height)
    if x0 >= x1 or y0 >= y1:
        return
    part = cover[y0 - top : y1 - top, x0 - left : x1 - left, None]
    tint = np.broadcast_to(np.asarray(colour, np.float32), (*cover.shape, 3))[
        y0 - top : y1 - top, x0 - left : x1 - left
    ]
    under = pixels[y0:y1, x0:x1]
    over = under * (1 - part) + np.concatenate((tint, np.ones_like(part)), 2) * part
    np.copyto(under, over, where=part > 0)


def _paint_words(pixels: Pixels, words: Words) -> None:
    if not words.text:
        return
    line = _line_of_text(words.text, words.size, words.bold)
    start = words.x - {Anchor.START: 0.0, Anchor.MIDDLE: line.width / 2, Anchor.END: line.width}[words.anchor]
    left, top = round(start) - line.left, round(words.y) - line.base
    if words.halo is not None:
        _put(pixels, left, top, line.halo, words.halo)
    _put(pixels, left, top, line.cover, words.colour)


class _Text(NamedTuple):
    """A line as coverage, and where its beginning lies in that."""

    cover: Pixels
    halo: Pixels
    left: int
    base: int
    width: int


@lru_cache(REMEMBERED)
def _line_of_text(text: str, size: int, bold: bool) -> _Text:
    """Remembered, since the frames of a movie have the same."""
    width, reach = width_of(text, size, bold), max(math.ceil(HALO * size), 1)
    room, above, below = reach + 2, 2 * size, size
    canvas = canvas_of(np.zeros((above + below + 2 * room, width + 2 * room + size, 1), np.float32))
    start = room
    for run in runs_of(text, bold):
        write(canvas, start, room + above, run.text, size, 1.0, run.font)
        start += advance(run, size)
    cover = pixels_of(canvas)[..., 0]
    return _Text(cover, _spread(cover, reach), room, room + above, width)


def _spread(cover: Pixels, reach: int) -> Pixels:
    """The greatest coverage within so many pixels."""
    spread = cover.copy()
    height, width = cover.shape
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if 0 < down * down + right * right <= reach * reach + 1:
                to = spread[max(down, 0) : height + min(down, 0), max(right, 0) : width + min(right, 0)]
                of = cover[max(-down, 0) : height + min(-down, 0), max(-right, 0) : width + min(-right, 0)]
                np.maximum(to, of, out=to)
    return spread


def _paint_line(pixels: Pixels, line: Line) -> None:
    if line.halo is not None:
        rim = max(line.thickness / 2, 1.0)
        _stroke(pixels, line, line.thickness / 2 + rim, rim, line.halo)
    _stroke(pixels, line, line.thickness / 2, 0.0, line.colour)


def _stroke(pixels: Pixels, line: Line, half: float, beyond: float, colour: Colour) -> None:
    """What is within `half` of a line that is longer by `beyond` at its ends; on whole pixels if level or upright."""
    if line.x0 == line.x1 or line.y0 == line.y1:
        x0, x1 = sorted((line.x0, line.x1))
        y0, y1 = sorted((line.y0, line.y1))
        level = line.y0 == line.y1
        ends, across = ((x0, x1), line.y0) if level else ((y0, y1), line.x0)
        thick = max(round(2 * half), 1)
        side = round(across - thick / 2)
        first, last = round(ends[0] - beyond), round(ends[1] + beyond)
        cover = np.ones((thick, last - first) if level else (last - first, thick), np.float32)
        _put(pixels, first if level else side, side if level else first, cover, colour)
        return
    reach = half + beyond + 1
    left, top = math.floor(min(line.x0, line.x1) - reach), math.floor(min(line.y0, line.y1) - reach)
    right, bottom = math.ceil(max(line.x0, line.x1) + reach), math.ceil(max(line.y0, line.y1) + reach)
    y, x = np.mgrid[top:bottom, left:right].astype(np.float32) + 0.5
    length = math.hypot(line.x1 - line.x0, line.y1 - line.y0)
    along_x, along_y = (line.x1 - line.x0) / length, (line.y1 - line.y0) / length
    along = (x - line.x0) * along_x + (y - line.y0) * along_y
    aside = np.abs((x - line.x0) * along_y - (y - line.y0) * along_x)
    cover = np.clip(half + 0.5 - aside, 0, 1) * np.clip(np.minimum(along + beyond, length + beyond - along) + 0.5, 0, 1)
    _put(pixels, left, top, cover.astype(np.float32), colour)


def _columns(x: float, width: float, count: int) -> tuple[int, NDArray[np.float64]]:
    """The first column of pixels, and where each lies among so many values whose first and last are at the edges."""
    first, last = round(x), round(x + width)
    place = (np.arange(first, last) + 0.5 - x) / width * (count - 1)
    return first, np.clip(place, 0, count - 1)


def _paint_ramp(pixels: Pixels, ramp: Ramp) -> None:
    first, place = _columns(ramp.x, ramp.width, len(ramp.colours))
    given = np.array(ramp.colours)
    colours = np.stack([np.interp(place, np.arange(len(given)), given[:, n]) for n in range(3)], 1)
    top, bottom = round(ramp.y), round(ramp.y + ramp.height)
    cover = np.ones((bottom - top, len(place)), np.float32)
    _put(pixels, first, top, cover, colours[None].astype(np.float32))


def _paint_area(pixels: Pixels, area: Area) -> None:
    first, place = _columns(area.x, area.width, len(area.heights))
    shares = np.interp(place, np.arange(len(area.heights)), area.heights)
    top, bottom = round(area.y), round(area.y + area.height)
    rows = (bottom - np.arange(top, bottom) - 1)[:, None]  # from below
    cover = np.clip(shares[None] * (bottom - top) - rows, 0, 1) * area.opacity
    _put(pixels, first, top, cover.astype(np.float32), area.colour)
