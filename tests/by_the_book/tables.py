"""Section 5 of docs/how_it_works/image.md: tables of 256 entries, and the 4096 opacities that there are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Points = list[tuple[float, float]]


@dataclass
class Patch:
    """As on the page: d0 and d1, e0 and e1, s0 and s1, the share of the rim, opacity, colours."""

    lower: tuple[float, float]
    upper: tuple[float, float]
    strength: tuple[float, float]
    soft: float
    opacity: float
    emit: tuple[float, float, float]
    refl: tuple[float, float, float]


def patched(patches: list[Patch], density: int, strength: int) -> tuple[float, Array, Array]:
    """Opacity and both colours at an entry of the plane."""
    through, weight, emit, refl = 1.0, 0.0, np.zeros(3), np.zeros(3)
    for patch in patches:
        w = patch.opacity * _inside(patch, density / 255, strength / 255)
        through, weight = through * (1 - w), weight + w
        emit, refl = emit + w * np.array(patch.emit), refl + w * np.array(patch.refl)
    return 1 - through, emit / (weight or 1), refl / (weight or 1)


def _inside(patch: Patch, d: float, s: float) -> float:
    s0, s1 = patch.strength
    u = (s - s0) / (s1 - s0)
    left, right = (a + (b - a) * u for a, b in zip(patch.lower, patch.upper, strict=True))
    return min(_along(s, s0, s1, patch.soft), _along(d, left, right, patch.soft)) if 0 <= u <= 1 else 0.0


def _along(x: float, low: float, high: float, soft: float) -> float:
    if not low <= x <= high:
        return 0.0
    rim = soft * (high - low) / 2
    up = 1.0 if low <= 0 or x - low >= rim else (x - low) / rim
    down = 1.0 if high >= 1 or high - x >= rim else (high - x) / rim
    return min(up, down)


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
