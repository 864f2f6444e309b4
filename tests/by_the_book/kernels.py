"""Section 7 of docs/how_it_works/image.md: kernels, and what of them a ray runs through."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CHORD_POINTS, SPACE_POINTS = 96, 400
PROFILE = 4096  # places at which P is worked out, evenly in the angle whose cosine is rho / R


def kernel(name: str, r: Array, radius: float) -> Array:
    if name == "gaussian":
        return np.exp(-(r**2) / (2 * 0.62**2))
    if name == "bspline":
        t = 2 * r / radius
        return np.where(t < 1, 2 / 3 - t**2 + t**3 / 2, np.maximum(2 - t, 0) ** 3 / 6)
    if name == "cone":
        return np.maximum(1 - r / radius, 0)
    q = np.sqrt(np.maximum(1 - (r / radius) ** 2, 0))
    x = 5.2 * radius * q
    turn, weights = _gauss(64)  # I2(x) is the mean of exp(x cos t) cos 2t over half a turn
    t = np.pi * turn
    bessel = (np.exp(x[..., None] * np.cos(t)) * np.cos(2 * t) * weights).sum(axis=-1)
    smooth: Array = q**2 * bessel
    return smooth


def projection(name: str, radius: float) -> Array:
    """P at rho = radius cos(angle), angles evenly from 0 to a right one."""
    nodes, weights = _gauss(CHORD_POINTS)
    angle = np.linspace(0, np.pi / 2, PROFILE)
    along = radius * np.sin(angle)[:, None] * nodes
    chord = (
        2
        * radius
        * np.sin(angle)
        * (kernel(name, np.sqrt((radius * np.cos(angle))[:, None] ** 2 + along**2), radius) * weights).sum(axis=1)
    )
    through: Array = chord / over_the_ball(lambda r: kernel(name, r, radius), radius)
    return through


def over_the_ball(profile: Callable[[Array], Array], radius: float) -> float:
    """The integral of what a radius alone decides."""
    nodes, weights = _gauss(SPACE_POINTS)
    return float(radius * (4 * np.pi * (radius * nodes) ** 2 * profile(radius * nodes) * weights).sum())


@cache
def _gauss(points: int) -> tuple[Array, Array]:
    """For integrals from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return (nodes + 1) / 2, weights / 2
