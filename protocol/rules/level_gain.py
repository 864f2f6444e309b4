"""How opaque footprints of a coarser level are, so that the volume lets as much light through as at its own resolution.

Footprints share an opacity a out over partial ones, w a each. What a layer of samples leaves of the light, the product
of all 1 - w a, depends on how finely it is shared out. On average over pixels its logarithm is -L(A a) / A, A being the
footprint's amplitude in front of the projected kernel P, and L(x) = -∫∫ ln(1 - x P). For a Gaussian L(x) is
G Li2(x / G), with G = 1 / P(0) and the dilogarithm Li2; kernels of the same radius are near enough to it.

A voxel that is f of the volume's voxels thick, of opacity a, must leave what f layers of these leave. At a = 1 that
takes `gain` times the opacity; below, 1 - (1 - a)^(f / gain) times the gain is within some percent of what it takes.
"""

import math

LEAST_PEAK = 2.4  # G: a little below that of the default kernel, so that no weight exceeds 1
SERIES_TERMS = 40  # for arguments up to 1/2: the next one is below 1e-15
HALVINGS = 52


def footprint_gain(amplitude: float, own_amplitude: float, thickness: float) -> float:
    """What multiplies a level's footprints: their amplitude, that of the volume's in the same view, f as above."""
    if thickness <= 1.0:
        return 1.0
    through = thickness * amplitude / own_amplitude * dilogarithm(min(own_amplitude / LEAST_PEAK, 1.0))
    return max(LEAST_PEAK * _inverse_dilogarithm(through) / amplitude, 1.0)


def dilogarithm(x: float) -> float:
    """Li2(x) for x from 0 to 1: x + x^2 / 4 + x^3 / 9 …"""
    if x in (0.0, 1.0):
        return x * math.pi**2 / 6
    if x > 0.5:
        return math.pi**2 / 6 - math.log(x) * math.log1p(-x) - dilogarithm(1.0 - x)
    return math.fsum(x**n / (n * n) for n in range(1, SERIES_TERMS + 1))


def _inverse_dilogarithm(y: float) -> float:
    """1 for all beyond Li2(1)."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if dilogarithm(middle) < y else (low, middle)
    return high
