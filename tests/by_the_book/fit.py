"""Section 3 of docs/how_it_works/image.md: what `fit` makes of zoom and centre."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Corner = tuple[int, int, int]


def fitted(
    values: Array,
    to_physical: Array,
    window: tuple[float, float],
    opacity: Array,
    bounds: tuple[Corner, Corner],
    radius: float,
    size: tuple[int, int],
    edges: bool,
    seen: Array | None,
) -> tuple[float, Array]:
    """Zoom and centre; `opacity` is that of each density, `values` are (k, j, i).

    `seen` has the screen's axes of a still as rows; it is None of what turns.
    """
    dims = np.array(values.shape[::-1])
    block = -(-dims // 32)
    kept = _kept(_shown(values, window, opacity, block, bounds))
    corners: list[tuple[int, ...]] = []
    for at in np.argwhere(kept):
        low = np.maximum(at * block, bounds[0])
        corners += product(*zip(low, np.minimum((at + 1) * block, bounds[1]) - 1, strict=True))
    corners = corners or list(product(*zip(bounds[0], np.array(bounds[1]) - 1, strict=True)))
    if edges:
        corners += product(*zip((0, 0, 0), dims - 1, strict=True))
    points = np.array(corners, dtype=float) @ to_physical.T
    if seen is None:
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        reaches = [np.linalg.norm(points - middle, axis=1).max()] * 2
    else:
        middle = seen.T @ ((points @ seen.T).min(axis=0) + (points @ seen.T).max(axis=0)) / 2
        reaches = list(abs((points - middle) @ seen.T).max(axis=0)[:2])
    h = abs(np.linalg.det(to_physical)) ** (1 / 3)
    sums = abs(to_physical)
    longest = np.sqrt(sums.sum(axis=1).max() * sums.sum(axis=0).max())
    z = np.inf
    for side, reach in zip(size, reaches, strict=True):
        b = (0.98 if seen is None else 0.94) * side / 2
        one = h * b / (reach + radius * longest)
        if one * longest < h and b > radius and reach > 0:
            one = min(one, h * (b - radius) / reach)
        z = min(z, one)
    return float(min(max(z, 1 / 64), 256.0)), np.linalg.inv(to_physical) @ middle


def _shown(
    values: Array, window: tuple[float, float], opacity: Array, block: Array, bounds: tuple[Corner, Corner]
) -> Array:
    seen = np.where(opacity > min(0.01, opacity.max() / 10), opacity, 0.0)
    dims = np.array(values.shape[::-1])
    shown = np.zeros(-(-dims // block))
    for at in np.ndindex(shown.shape):
        low = np.array(at) * block
        high = np.minimum(low + block, dims)
        there = values[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
        there = there[np.isfinite(there)]
        if there.size and (high > bounds[0]).all() and (low < bounds[1]).all():
            first, last = (_density(value, window) for value in (there.min(), there.max()))
            shown[at] = seen[first : last + 1].mean()
    return shown


def _density(value: float, window: tuple[float, float]) -> int:
    low, high = window
    return int(np.floor(np.clip((value - low) * (255 / (high - low)), 0, 255) + 0.5))


def _kept(shown: Array) -> NDArray[np.bool_]:
    kept = shown > 0
    inner = ~_near(shown == 0, 1)
    aside = kept & ~_near(inner, 2) & (shown < shown.max() / 4)
    if shown[aside].sum() <= 0.01 * shown.sum():
        kept = kept & ~aside
    alone = np.zeros_like(kept)
    for at in np.argwhere(kept):
        others = kept.copy()
        others[tuple(at)] = False
        alone[tuple(at)] = not _near(others, 1)[tuple(at)]
    return kept & ~alone if alone.sum() <= 0.01 * kept.sum() else kept


def _near(blocks: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Which have one of these within so many blocks on every axis."""
    near, wide = np.zeros_like(blocks), np.pad(blocks, reach)
    ni, nj, nk = blocks.shape
    for i, j, k in product(range(2 * reach + 1), repeat=3):
        near |= wide[i : i + ni, j : j + nj, k : k + nk]
    return near
