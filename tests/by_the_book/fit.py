"""Section 3 of docs/how_it_works/image.md: what `fit` makes of zoom and centre."""

from itertools import combinations, product

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
) -> tuple[float, Array]:
    """Zoom and centre; `opacity` is that of each density, `values` are (k, j, i)."""
    dims = np.array(values.shape[::-1])
    block = -(-dims // 32)
    kept = _kept(_visible(values, window, opacity, block, bounds))
    corners: list[tuple[int, ...]] = []
    for at in np.argwhere(kept):
        low = np.maximum(at * block, bounds[0])
        corners += product(*zip(low, np.minimum((at + 1) * block, bounds[1]) - 1, strict=True))
    corners = corners or list(product(*zip(bounds[0], np.array(bounds[1]) - 1, strict=True)))
    if edges:
        corners += product(*zip((0, 0, 0), dims - 1, strict=True))
    middle, reach = _smallest_ball(np.unique(np.array(corners, dtype=float), axis=0) @ to_physical.T)
    h, b = abs(np.linalg.det(to_physical)) ** (1 / 3), 0.98 * min(size) / 2
    sums = abs(to_physical)
    longest = np.sqrt(sums.sum(axis=1).max() * sums.sum(axis=0).max())
    z = h * b / (reach + radius * longest)
    if z * longest < h and b > radius and reach > 0:
        z = min(z, h * (b - radius) / reach)
    return float(min(max(z, 1 / 64), 256.0)), np.linalg.inv(to_physical) @ middle


def _visible(
    values: Array, window: tuple[float, float], opacity: Array, block: Array, bounds: tuple[Corner, Corner]
) -> NDArray[np.bool_]:
    seen = opacity > min(0.01, opacity.max() / 10)
    dims = np.array(values.shape[::-1])
    visible = np.zeros(-(-dims // block), dtype=bool)
    for at in np.ndindex(visible.shape):
        low = np.array(at) * block
        high = np.minimum(low + block, dims)
        there = values[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
        there = there[np.isfinite(there)]
        if there.size and (high > bounds[0]).all() and (low < bounds[1]).all():
            first, last = (_density(value, window) for value in (there.min(), there.max()))
            visible[at] = seen[first : last + 1].any()
    return visible


def _density(value: float, window: tuple[float, float]) -> int:
    low, high = window
    return int(np.floor(np.clip((value - low) * (255 / (high - low)), 0, 255) + 0.5))


def _kept(visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    around, wide = np.zeros_like(visible), np.pad(visible, 1)
    for i, j, k in set(product(range(3), repeat=3)) - {(1, 1, 1)}:
        ni, nj, nk = visible.shape
        around |= wide[i : i + ni, j : j + nj, k : k + nk]
    kept = visible & around
    return kept if visible.sum() - kept.sum() <= 0.01 * visible.sum() else visible


def _smallest_ball(points: Array) -> tuple[Array, float]:
    """The ball of a few points, of which the one that lies farthest outside is always taken in."""
    held = points[:1]
    middle, reach = points[0], 0.0
    while True:
        away = np.linalg.norm(points - middle, axis=1)
        if away.max() <= reach * (1 + 1e-9):
            return middle, float(away.max())
        few = np.vstack([held, points[away.argmax()]])
        balls = [
            (*_through(few[list(chosen)]), few[list(chosen)])
            for n in (2, 3, 4)
            for chosen in combinations(range(len(few)), n)
        ]
        holding = [ball for ball in balls if np.linalg.norm(few - ball[0], axis=1).max() <= ball[1] * (1 + 1e-9)]
        middle, reach, held = min(holding, key=lambda ball: ball[1])


def _through(points: Array) -> tuple[Array, float]:
    """The smallest ball that has all of these points on it, if they lie on one."""
    edges = points[1:] - points[0]
    to_middle = np.linalg.lstsq(2 * edges, (edges**2).sum(axis=1), rcond=None)[0]
    return points[0] + to_middle, float(np.linalg.norm(to_middle))
