"""The room over a picture, in which no words are put over other ones, nor over bars, where there is a free place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar

from volsplat.client.figure.drawing import Anchor, Line, Shape, Words
from volsplat.client.figure.type_faces import width_of

ASCENT, DESCENT, ASIDE = 0.85, 0.3, 0.15  # of words' size: above and below the base line, and at each end


class Rectangle(NamedTuple):
    """In pixels, y down."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Rectangle) -> bool:
        apart = self.right <= other.left or other.right <= self.left
        return not (apart or self.bottom <= other.top or other.bottom <= self.top)

    def holds(self, other: Rectangle) -> bool:
        across = self.left <= other.left and other.right <= self.right
        return across and self.top <= other.top and other.bottom <= self.bottom

    def is_crossed_by(self, line: Line) -> bool:
        """Whether any of the line lies within: what is left of it, cut at each side in turn."""
        first, last = 0.0, 1.0
        for start, end, low, high in (
            (line.x0, line.x1, self.left, self.right),
            (line.y0, line.y1, self.top, self.bottom),
        ):
            if start == end:
                if not low < start < high:
                    return False
                continue
            enters, leaves = sorted(((low - start) / (end - start), (high - start) / (end - start)))
            first, last = max(first, enters), min(last, leaves)
        return first < last


class Trouble(NamedTuple):
    """What is wrong with a place, the worst first."""

    covered: int  # words and bars that would lie over one another, or beyond the picture
    crossed: int  # words that a line would run through


NONE = Trouble(0, 0)
Place = TypeVar("Place", bound=Sequence[Shape])


class Room:
    """What is free over the picture; whoever comes first has the choice."""

    def __init__(self, left: float, top: float, width: float, height: float) -> None:
        self._all = Rectangle(left, top, left + width, top + height)
        self._boxes: list[Rectangle] = []
        self._lines: list[Line] = []

    def take(self, shapes: Iterable[Shape]) -> None:
        """Level lines are bars, which words keep clear of as of other words."""
        for shape in shapes:
            if (box := _box(shape)) is not None:
                self._boxes.append(box)
            elif isinstance(shape, Line):
                self._lines.append(shape)

    def best(self, places: Iterable[Place]) -> Place:
        """The first of the places with the least trouble; none is looked at after one without any."""
        tried: list[tuple[Trouble, Place]] = []
        for place in places:
            trouble = self.trouble(place)
            if trouble == NONE:
                return place
            tried.append((trouble, place))
        return min(tried, key=lambda one: one[0])[1]

    def trouble(self, shapes: Iterable[Shape]) -> Trouble:
        covered = crossed = 0
        for shape in shapes:
            if (box := _box(shape)) is not None:
                covered += sum(map(box.meets, self._boxes)) + (not self._all.holds(box))
                crossed += sum(map(box.is_crossed_by, self._lines))
            elif isinstance(shape, Line):
                crossed += sum(other.is_crossed_by(shape) for other in self._boxes)
        return Trouble(covered, crossed)


def _box(shape: Shape) -> Rectangle | None:
    """What words or a bar take; None of any other shape."""
    if isinstance(shape, Words):
        wide, aside = width_of(shape.text, shape.size, shape.bold), ASIDE * shape.size
        left = shape.x - {Anchor.START: 0.0, Anchor.MIDDLE: wide / 2, Anchor.END: wide}[shape.anchor]
        top, bottom = shape.y - ASCENT * shape.size, shape.y + DESCENT * shape.size
        return Rectangle(left - aside, top, left + wide + aside, bottom)
    if isinstance(shape, Line) and shape.y0 == shape.y1:
        return Rectangle(shape.x0, shape.y0 - shape.thickness, shape.x1, shape.y1 + shape.thickness)
    return None
