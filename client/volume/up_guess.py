"""Which way is up in a volume whose file does not say: a guess by what lies where, the same for every scene.

What a scanner takes of a body is cut off where the scan ends and has its own end where it does not: a head runs from
its crown to a neck that is cut. So the end at which what is there tapers is up, where the other one is cut. An empty
margin about it changes nothing, and if both ends are alike nothing is guessed.
"""

import math
from collections import Counter
from itertools import product
from typing import NamedTuple

from volsplat.client.histogram.density_histogram import LAST, otsu_byte
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.upright import Up

WIDE = 0.2  # of the widest layer: less than that is no end that was cut off
STEADY = 0.64  # of the layer two further in: an end of at least so much is cut off
TAPER = 0.8  # of the cut end's share of that layer: the other end tapers with at most so much of it
LEAST_LAYER = 0.02  # of the widest layer; less is no end but dirt
OBJECT = 0.3  # of the way from what is empty to what is full: from here on something is there
CLIPPED = 0.01  # share of the blocks at either end of their values that says nothing of the two


class StandsUp(NamedTuple):
    """The physical axis that is up, and how that is known, for a person."""

    up: Up
    why: str


def stands_up(description: VolumeDescription, extremes: BlockExtremes) -> StandsUp:
    """What the file says, or the guess, or +z."""
    if description.up is not None:
        return StandsUp(description.up, "superior of the patient" if description.anatomical else "as the format tells")
    guess = guessed_up(description.geometry, extremes)
    if guess is not None:
        return StandsUp(guess, "a guess, for what is there tapers that way and is cut off at the other; --up sets it")
    return StandsUp("+z", "for want of any sign of it; --up sets it")


def guessed_up(geometry: Geometry, extremes: BlockExtremes) -> Up | None:
    """+z or -z, by the layers of blocks along the grid axis that lies nearest to z; None without a sign of it."""
    steps = [matrices.normalised(matrices.column(geometry.index_to_physical, axis))[2] for axis in range(3)]
    axis = max(range(3), key=lambda n: abs(steps[n]))
    layers = _layers(extremes, block_dims(geometry.dims), axis)
    widest = max(layers)
    filled = [count for count in layers if count > LEAST_LAYER * widest]
    if len(filled) < 3:
        return None
    first, last = filled[0] / filled[2], filled[-1] / filled[-3]
    cut = filled[0] if last < first else filled[-1]
    if cut < WIDE * widest or max(first, last) < STEADY or min(first, last) > TAPER * max(first, last):
        return None
    return "+z" if (last < first) == (steps[axis] > 0) else "-z"


def _layers(extremes: BlockExtremes, dims: tuple[int, int, int], axis: int) -> list[int]:
    """How many blocks of each layer across an axis have something in them."""
    there = _object_blocks(extremes, dims)
    counts = [0] * dims[axis]
    below = math.prod(dims[:axis])
    for block in there:
        counts[block // below % dims[axis]] += 1
    return counts


def _object_blocks(extremes: BlockExtremes, dims: tuple[int, int, int]) -> list[int]:
    """The blocks in which something is, wherever the volume's margin is empty of it."""
    margins = _margins(extremes, dims)
    greatest = {
        n: high
        for n, (low, high) in enumerate(zip(extremes.least, extremes.greatest, strict=True))
        if low <= high and high not in margins
    }
    if not greatest:
        return []
    edge = _edge(sorted(greatest.values()))
    return [n for n, value in greatest.items() if value > edge]


def _margins(extremes: BlockExtremes, dims: tuple[int, int, int]) -> set[float]:
    """What most blocks of an outer face have as their greatest value: clipped air, or what somebody filled up with."""
    strides = (1, dims[0], dims[0] * dims[1])
    margins = set()
    for axis in range(3):
        across, along = (n for n in range(3) if n != axis)
        for end in (0, dims[axis] - 1):
            first = end * strides[axis]
            places = product(range(dims[across]), range(dims[along]))
            face = [extremes.greatest[first + a * strides[across] + b * strides[along]] for a, b in places]
            value, count = Counter(face).most_common(1)[0]
            if 2 * count > len(face):
                margins.add(value)
    return margins


def _edge(values: list[float]) -> float:
    """The value above which something is, by Otsu's split of what is empty from what is full."""
    clipped = math.floor(CLIPPED * len(values))
    low, high = values[clipped], values[-1 - clipped]
    width = (high - low) / (LAST + 1)
    if width <= 0.0:  # all that is no margin is of one value
        return -math.inf
    counts = [0.0] * (LAST + 1)
    for value in values:
        counts[min(max(math.floor((value - low) / width), 0), LAST)] += 1
    split = low + (otsu_byte(counts) + 1) * width
    empty = [min(max(value, low), high) for value in values if value < split]
    full = [min(value, high) for value in values if value >= split]
    if not empty or not full:
        return -math.inf
    below, above = math.fsum(empty) / len(empty), math.fsum(full) / len(full)
    return below + OBJECT * (above - below)
