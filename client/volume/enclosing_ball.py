"""The smallest ball that holds given points."""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector

MOST_ROUNDS = 64  # each takes in the point that lies farthest out; a dozen are usual
OUTSIDE = 1e-9  # of the radius: what is farther out by less is held

Points = NDArray[np.float64]  # (n, 3)


class Ball(NamedTuple):
    centre: Vector
    radius: float


def enclosing_ball(points: Points) -> Ball:
    """The smallest ball about the points, of which there is at least one; none lies outside."""
    held = [_vector(points[0])]
    ball = Ball(held[0], 0.0)
    for _ in range(MOST_ROUNDS):
        distances = squared_distances(ball.centre, points)
        farthest = int(distances.argmax())
        if distances[farthest] <= (ball.radius * (1 + OUTSIDE)) ** 2:
            break
        ball, held = _ball_of_few([*held, _vector(points[farthest])])
    return Ball(ball.centre, reach(ball.centre, points))


def reach(centre: Vector, points: Points) -> float:
    """How far away the farthest point is."""
    return math.sqrt(squared_distances(centre, points).max())


@np.errstate(over="ignore")  # of grids as wide as numbers are
def squared_distances(centre: Vector, points: Points) -> NDArray[np.float64]:
    """(n,), by the very operations of `matrices`."""
    off: Points = points - centre
    x, y, z = off.T
    squares: NDArray[np.float64] = x * x + y * y + z * z
    return squares


def _vector(point: NDArray[np.float64]) -> Vector:
    x, y, z = point.tolist()
    return (x, y, z)


def _ball_of_few(points: list[Vector]) -> tuple[Ball, list[Vector]]:
    """The smallest ball of at most five points, and those of them that lie on it."""
    best, on_it = Ball(points[0], math.inf), points
    for count in (2, 3, 4):
        for chosen in combinations(points, count):
            ball = _ball_through(chosen)
            if ball is None or ball.radius >= best.radius:
                continue
            off = [matrices.minus(point, ball.centre) for point in points]
            if max(matrices.dot(one, one) for one in off) <= (ball.radius * (1 + OUTSIDE)) ** 2:
                best, on_it = ball, list(chosen)
    return best, on_it


def _ball_through(points: Sequence[Vector]) -> Ball | None:
    """The smallest ball with two to four points on it; None if they have none or lie in a lesser space."""
    first = points[0]
    edges = [matrices.minus(point, first) for point in points[1:]]
    # The centre is first + sum of w_n edge_n, as far from each point: 2 edge_m . (centre - first) = |edge_m|^2.
    rows = [[2 * matrices.dot(a, b) for b in edges] + [matrices.dot(a, a)] for a in edges]
    weights = _solved(rows)
    if weights is None:
        return None
    offset: Vector = (0.0, 0.0, 0.0)
    for weight, edge in zip(weights, edges, strict=True):
        offset = matrices.plus(offset, matrices.scaled(edge, weight))
    return Ball(matrices.plus(first, offset), matrices.length(offset))


def _solved(rows: list[list[float]]) -> list[float] | None:
    """The solution of linear equations, coefficients then right side by rows; None if they have no single one."""
    count = len(rows)
    for n in range(count):
        pivot = max(range(n, count), key=lambda m: abs(rows[m][n]))
        rows[n], rows[pivot] = rows[pivot], rows[n]
        if abs(rows[n][n]) <= OUTSIDE * abs(rows[n][-1]) or rows[n][n] == 0.0:
            return None
        for m in range(count):
            if m != n:
                factor = rows[m][n] / rows[n][n]
                rows[m] = [a - factor * b for a, b in zip(rows[m], rows[n], strict=True)]
    return [rows[n][-1] / rows[n][n] for n in range(count)]
