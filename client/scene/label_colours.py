"""Colours for labels whose file gives none: each number's is far from those of all numbers before it.

Distances are those of OKLab (Ottosson 2020), in which equal steps look alike. Very dark, very bright and grey ones are
left out: on lit surfaces they would be taken for shadows, highlights and bone.
"""

import math
from functools import cache

from volsplat.protocol.description.colours import Colour

HUES = 24
LIGHTNESSES = (0.56, 0.66, 0.76, 0.86)
CHROMAS = (0.06, 0.12)
FIRST = (0.66, 0.12, 0.11)  # lightness, chroma and turns of the first: a red like tissue's

Lab = tuple[float, float, float]


def label_colour(number: int) -> Colour:
    """Always the same for a number; after 192 colours they come again."""
    colours = _colours()
    return colours[(number - 1) % len(colours)]


@cache
def _colours() -> tuple[Colour, ...]:
    """The one first that is farthest from all that have come."""
    left = {_lab(light, chroma, hue / HUES) for light in LIGHTNESSES for chroma in CHROMAS for hue in range(HUES)}
    chosen = [_lab(*FIRST)]
    nearest = {lab: math.dist(lab, chosen[0]) for lab in sorted(left)}
    while nearest:
        farthest = max(nearest, key=nearest.__getitem__)
        del nearest[farthest]
        chosen.append(farthest)
        for lab, distance in nearest.items():
            nearest[lab] = min(distance, math.dist(lab, farthest))
    return tuple(map(_srgb, chosen[:-1]))


def _lab(lightness: float, chroma: float, turns: float) -> Lab:
    angle = 2 * math.pi * turns
    return (lightness, chroma * math.cos(angle), chroma * math.sin(angle))


def _srgb(lab: Lab) -> Colour:
    """What is out of a screen's reach at its border."""
    lightness, a, b = lab
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    middle = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    red = 4.0767416621 * long - 3.3077115913 * middle + 0.2309699292 * short
    green = -1.2684380046 * long + 2.6097574011 * middle - 0.3413193965 * short
    blue = -0.0041960863 * long - 0.7034186147 * middle + 1.7076147010 * short
    return (_encoded(red), _encoded(green), _encoded(blue))


def _encoded(linear: float) -> float:
    """By sRGB's curve, a multiple of 1/255."""
    linear = min(max(linear, 0.0), 1.0)
    value = 12.92 * linear if linear <= 0.0031308 else 1.055 * linear ** (1 / 2.4) - 0.055
    return round(255 * value) / 255
