"""A drawing: a picture and what is drawn over and about it, in pixels from the upper left corner, y down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.colours import Colour

STRAIGHT = 1e-9  # by how much a table's entries leave a straight line by rounding alone


class Anchor(StrEnum):
    """Which end of a line of words lies at its place."""

    START = "start"
    MIDDLE = "middle"
    END = "end"


class Words(NamedTuple):
    """One line of text, its base line at y."""

    x: float
    y: float
    text: str
    size: int
    colour: Colour
    halo: Colour | None = None  # what sets it off where it lies over the picture
    anchor: Anchor = Anchor.START
    bold: bool = False


class Line(NamedTuple):
    """A straight line with square ends."""

    x0: float
    y0: float
    x1: float
    y1: float
    thickness: float
    colour: Colour
    halo: Colour | None = None


class Pen(NamedTuple):
    """What draws words and lines over the picture, the latter so many ems thick, but a pixel at least."""

    em: int  # the size of words, in pixels
    ink: Colour
    paper: Colour  # sets them off

    def words(self, x: float, y: float, text: str, anchor: Anchor = Anchor.START, bold: bool = False) -> Words:
        return Words(x, y, text, self.em, self.ink, self.paper, anchor, bold)

    def line(self, x0: float, y0: float, x1: float, y1: float, ems: float) -> Line:
        return Line(x0, y0, x1, y1, max(ems * self.em, 1.0), self.ink, self.paper)


class Box(NamedTuple):
    """A filled rectangle."""

    x: float
    y: float
    width: float
    height: float
    colour: Colour


class Ramp(NamedTuple):
    """Colours from left to right, the first and the last at the edges."""

    x: float
    y: float
    width: float
    height: float
    colours: tuple[Colour, ...]

    def stops(self) -> list[tuple[float, Colour]]:
        """Positions 0 to 1 and their colours, without those that lie on the straight line between others."""
        last = len(self.colours) - 1
        return [(n / last, self.colours[n]) for n in _bends(self.colours)]


class Area(NamedTuple):
    """What lies below a curve over equal steps, the ends at the edges; `heights` are shares of `height`."""

    x: float
    y: float
    width: float
    height: float
    heights: tuple[float, ...]
    colour: Colour
    opacity: float

    def outline(self) -> list[tuple[float, float]]:
        """The curve's points, without those that lie on the straight line between others."""
        last = len(self.heights) - 1
        return [
            (self.x + n / last * self.width, self.y + (1 - self.heights[n]) * self.height)
            for n in _bends([(height,) for height in self.heights])
        ]


def _bends(values: Sequence[tuple[float, ...]]) -> list[int]:
    """The first and the last, and those between that are not as far from the one before as from the one after."""
    inner = (
        n
        for n in range(1, len(values) - 1)
        if any(abs(a - 2 * b + c) > STRAIGHT for a, b, c in zip(*values[n - 1 : n + 2], strict=True))
    )
    return [0, *inner, len(values) - 1]


Shape = Words | Line | Box | Ramp | Area


@dataclass(frozen=True)
class Drawing:
    """`picture` is (H, W, 4) float32, associated alpha, its upper left corner at `corner`, which are whole pixels."""

    width: int
    height: int
    dpi: float
    picture: NDArray[np.float32]
    corner: tuple[int, int]
    background: Colour | None  # None: clear
    shapes: tuple[Shape, ...]
