"""Section 5 of docs/how_it_works/image.md: tables of 256 entries, and the 4096 opacities that there are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int64]
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


def patched(patches: list[Patch], density: Codes, strength: int) -> tuple[Array, Array, Array]:
    """Opacities (n) and both colours (n, 3) at entries of a row of the plane."""
    through, weight = np.ones(len(density)), np.zeros(len(density))
    emit, refl = (np.zeros((len(density), 3)) for _ in range(2))
    for patch in patches:
        w = patch.opacity * _inside(patch, density / 255, strength / 255)
        through, weight = through * (1 - w), weight + w
        emit, refl = emit + np.outer(w, patch.emit), refl + np.outer(w, patch.refl)
    whole = np.where(weight > 0, weight, 1)[:, None]
    return 1 - through, emit / whole, refl / whole


def _inside(patch: Patch, d: Array, s: float) -> Array:
    s0, s1 = patch.strength
    u = (s - s0) / (s1 - s0)
    left, right = (a + (b - a) * u for a, b in zip(patch.lower, patch.upper, strict=True))
    across = _along(np.array(s), s0, s1, patch.soft)
    return np.minimum(across, _along(d, left, right, patch.soft)) if 0 <= u <= 1 else np.zeros(d.shape)


def _along(x: Array, low: float, high: float, soft: float) -> Array:
    rim = soft * (high - low) / 2
    up = np.ones(x.shape) if low <= 0 or rim == 0 else (x - low) / rim
    down = np.ones(x.shape) if high >= 1 or rim == 0 else (high - x) / rim
    return np.where((low <= x) & (x <= high), np.minimum(1, np.minimum(up, down)), 0)


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
