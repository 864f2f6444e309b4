"""Section 5 of docs/how_it_works/image.md: tables of 256 entries, and the 4096 opacities that there are."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Points = list[tuple[float, float]]


def table(points: Points) -> Array:
    """256 entries; of points at one position the later one holds from there on."""
    entries = []
    for n in range(256):
        position = n / 255
        before = [p for p in points if p[0] <= position]
        after = [p for p in points if p[0] > position]
        if not before or not after:
            entries.append(before[-1][1] if before else after[0][1])
            continue
        (p0, v0), (p1, v1) = before[-1], after[0]
        entries.append(v0 + (v1 - v0) * ((position - p0) / (p1 - p0)))
    return np.array(entries)


def coded(opacity: float) -> float:
    """The nearest of the 4096 that there are, halves up."""
    codes = _CODES
    return float(codes[np.searchsorted((codes[1:] + codes[:-1]) / 2, opacity, side="right")])


_CODES = np.array(
    [(c & 255 if c < 256 else (256 + (c & 255)) * 2 ** ((c >> 8) - 1)) / (511 * 2**14) for c in range(4096)]
)
