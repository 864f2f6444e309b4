"""Section 10 of docs/how_it_works/image.md: what a white edge covers."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def covered(shape: tuple[int, ...], points: list[list[float]], width: float) -> Array:
    """How much of each pixel a line between two points covers."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    (x0, y0), (x1, y1) = points
    dx, dy = x1 - x0, y1 - y0
    length = dx * dx + dy * dy
    along = np.clip(((x - x0) * dx + (y - y0) * dy) / length, 0, 1) if length else 0.0
    distance = np.hypot(x - x0 - along * dx, y - y0 - along * dy)
    share: Array = np.clip(width / 2 + 0.5 - distance, 0, min(width, 1.0))
    return share
