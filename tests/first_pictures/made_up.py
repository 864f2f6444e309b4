"""Volumes for presets of which no scan is at hand: made up roughly, with values as scans have them."""

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float32]  # [z, y, x]; x to the left, y to the back, z up

AIR, FAT, FLESH, LUNG, CONTRAST, BONE = -1000.0, -100.0, 40.0, -850.0, 330.0, 700.0  # HU
NOISE = 12.0
SIDES = (88, 72, 104)  # z, y, x
GENERATIONS = 6


def chest(contrast: bool, seed: int = 1) -> Values:
    """A CT: ribs, spine, heart and lungs with their vessels, which hold contrast agent or not.

    Without it, it is blurred by a voxel, for the walls; with it bone would get a rim as of contrast agent.
    """
    z, y, x = _axes()
    hu = np.full(SIDES, AIR, np.float32)
    body = _ellipsoid(0, 0, 0, 1.6, 0.8, 0.9)
    inside = _ellipsoid(0, 0, 0, 1.55, 0.72, 0.82)
    hu[body] = FAT
    hu[inside] = FLESH
    wall = _ellipsoid(0, 0, 0, 1.35, 0.66, 0.76) & ~_ellipsoid(0, 0, 0, 1.28, 0.59, 0.69)
    hu[wall & (np.sin(26 * (z - 0.35 * np.abs(x))) > 0.45)] = BONE
    hu[(np.hypot(x, y - 0.55) < 0.12) & (np.sin(30 * z) > -0.8)] = BONE
    lungs = (_ellipsoid(0.02, 0, 0.42, 0.85, 0.5, 0.3) | _ellipsoid(0.02, 0, -0.42, 0.85, 0.5, 0.3)) & inside
    hu[lungs] = LUNG
    heart = _ellipsoid(-0.25, -0.15, 0.12, 0.32, 0.26, 0.26)
    full = CONTRAST if contrast else FLESH
    hu[heart] = full
    random = np.random.default_rng(seed)
    for side in (-1.0, 1.0):
        vessels = _tree(random, np.array([0.0, 0.0, 0.15 * side]), np.array([0.0, 0.1, side]), 0.055)
        hu[vessels & (lungs | heart)] = full
    if contrast:
        hu[(np.hypot(x - 0.05, y - 0.3) < 0.075) & (z < 0.6)] = CONTRAST
    else:
        hu = _blurred(hu)
    return (hu + random.normal(0, NOISE, SIDES)).astype(np.float32)


def vessels_of_a_head(seed: int = 3) -> Values:
    """Time-of-flight MR: tissue of even grey, blood three times as bright."""
    random = np.random.default_rng(seed)
    values = np.where(_ellipsoid(0, 0, 0, 0.9, 0.85, 0.8), 100.0, 8.0)
    for side in (-1.0, 1.0):
        start = np.array([-0.75, 0.0, 0.12 * side])
        values[_tree(random, start, np.array([1.0, -0.1, 0.3 * side]), 0.055)] = 320.0
    return (values + random.normal(0, 8, SIDES)).astype(np.float32)


def differences(seed: int = 2) -> Values:
    """What a model lacks, and what it has too much of, beside noise."""
    random = np.random.default_rng(seed)
    values = random.normal(0, 0.02, SIDES)
    z, y, x = _axes()
    for n, place in enumerate(random.uniform(-0.7, 0.7, (24, 3))):
        distance = (z - place[0]) ** 2 + (y - place[1]) ** 2 + (x - place[2]) ** 2
        values += (1 if n % 3 else -1) * np.exp(-distance / 0.012)
    return values.astype(np.float32)


def _blurred(values: Values) -> Values:
    """Each voxel with a share of its neighbours, as a scanner has it: walls then have the values between."""
    blurred = values
    for axis in range(3):
        padded = np.pad(blurred, [(int(at == axis),) * 2 for at in range(3)], mode="edge")
        low, middle, high = (padded.take(range(begin, begin + SIDES[axis]), axis) for begin in range(3))
        blurred = np.asarray((low + 2 * middle + high) / 4, np.float32)
    return blurred


def _axes() -> list[NDArray[np.float64]]:
    """-1 to 1 along the longest axis, as much for each voxel of the others; each along its own axis of three."""
    most = max(SIDES)
    return list(np.meshgrid(*(np.linspace(-n / most, n / most, n) for n in SIDES), indexing="ij", sparse=True))


def _ellipsoid(z: float, y: float, x: float, *radii: float) -> NDArray[np.bool_]:
    distances = ((axis - at) / radius for axis, at, radius in zip(_axes(), (z, y, x), radii, strict=True))
    return np.asarray(sum(distance**2 for distance in distances) < 1)


def _tree(
    random: np.random.Generator, start: NDArray[np.float64], way: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """A vessel that forks, each time thinner and shorter."""
    tubes = np.zeros(SIDES, np.bool_)
    axes = _axes()
    ends = [(start, way / np.linalg.norm(way))]
    for _ in range(GENERATIONS):
        forks = []
        for begin, towards in ends:
            end = begin + towards * radius * 4.5
            for share in np.linspace(0, 1, 6):
                tubes |= _ball(axes, begin + share * (end - begin), radius)
            for _ in range(2):
                turned = towards + random.normal(0, 0.55, 3)
                forks.append((end, turned / np.linalg.norm(turned)))
        ends, radius = forks, radius * 0.82
    return tubes


def _ball(axes: list[NDArray[np.float64]], middle: NDArray[np.float64], radius: float) -> NDArray[np.bool_]:
    return np.asarray(sum((axis - at) ** 2 for axis, at in zip(axes, middle, strict=True)) < radius**2)
