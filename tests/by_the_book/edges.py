"""Section 10 of docs/how_it_works/image.md: what white edges cover."""

import itertools

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import Book
from by_the_book.placing import Placing

Array = NDArray[np.float64]


def between_edges(buffer: Array, book: Book, placing: Placing) -> Array:
    """The image (H, W, 4) with edges behind it and in front of it."""
    whole = ((0, 0, 0), placing.dims)
    front, behind = (np.zeros(buffer.shape[:2]) for _ in range(2))
    boxes = [(whole, 1.5)] + ([] if book.bounds == whole else [(book.bounds, 0.75)])
    facing = np.linalg.inv(placing.screen)[:, 2]
    for (low, high), line_width in boxes:
        for axis, *ends in itertools.product(range(3), (0, 1), (0, 1)):
            others = [a for a in range(3) if a != axis]
            seen = any(facing[a] * (1 if end else -1) >= 0 for a, end in zip(others, ends, strict=True))
            points = []
            for along in (0, 1):
                upper = {axis: along, **dict(zip(others, ends, strict=True))}
                doubled = [2 * high[a] - 1 if upper[a] else 2 * low[a] - 1 for a in range(3)]
                points.append([x / 2.0**32 for x in placing.fixed(doubled)])
            layer = front if seen else behind
            np.maximum(layer, _covered(layer.shape, points, line_width), out=layer)
    f, k = front[..., None], behind[..., None]
    drawn: Array = f + (1 - f) * (buffer + (1 - buffer[..., 3:]) * k)
    return drawn


def _covered(shape: tuple[int, ...], points: list[list[float]], width: float) -> Array:
    """How much of each pixel a line between two points covers."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    (x0, y0), (x1, y1) = points
    dx, dy = x1 - x0, y1 - y0
    length = dx * dx + dy * dy
    along = np.clip(((x - x0) * dx + (y - y0) * dy) / length, 0, 1) if length else 0.0
    distance = np.hypot(x - x0 - along * dx, y - y0 - along * dy)
    share: Array = np.clip(width / 2 + 0.5 - distance, 0, min(width, 1.0))
    return share
