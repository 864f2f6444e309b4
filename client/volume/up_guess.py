"""Which way is up in a volume whose file does not say: a guess by what lies where, the same for every scene.

What a scanner takes of a body is cut off where the scan ends and has its own end where it does not: a head runs from
its crown to a neck that is cut. So the end at which what is there tapers is up, where the other one is cut. An empty
margin about it changes nothing, and if both ends are alike nothing is guessed.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    told: bool = True  # by the file or by what lies where


def stands_up(description: VolumeDescription, extremes: BlockExtremes) -> StandsUp:
    """What the file says, or the guess, or +z."""
    if description.up is not None:
        return StandsUp(
            description.up,
            "superior of the patient" if description.anatomical else "as its format or its vertical axis has it",
        )
    guess = guessed_up(description.geometry, extremes)
    if guess is not None:
        return StandsUp(guess, "a guess, for what is there tapers that way and is cut off at the other; --up sets it")
    return StandsUp("+z", "for want of any sign of it; --up sets it", told=False)


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
    across = tuple(n for n in range(3) if n != 2 - axis)
    return [int(count) for count in _objects(extremes, dims).sum(axis=across)]


def _objects(extremes: BlockExtremes, dims: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Of each block, shaped (k, j, i), whether something is in it, wherever the volume's margin is empty of it."""
    least, greatest = (np.array(values).reshape(dims[::-1]) for values in extremes)
    known = (least <= greatest) & ~np.isin(greatest, _margins(greatest))
    return known & (greatest > _edge(np.sort(greatest[known]))) if known.any() else known


def _margins(greatest: NDArray[np.float64]) -> list[float]:
    """What most blocks of an outer face have as their greatest value: clipped air, or what somebody filled up with."""
    margins = []
    for axis, end in product(range(3), (0, -1)):
        values, counts = np.unique(greatest.take(end, axis), return_counts=True)
        if 2 * counts.max() > counts.sum():
            margins.append(float(values[counts.argmax()]))
    return margins


@np.errstate(over="ignore")  # some files fill with the greatest numbers that there are
def _edge(values: NDArray[np.float64]) -> float:
    """The value above which something is, of values in order: by Otsu's split of what is empty from what is full."""
    clipped = math.floor(CLIPPED * len(values))
    low, high = float(values[clipped]), float(values[-1 - clipped])
    width = (high - low) / (LAST + 1)
    if not 0.0 < width < math.inf:  # all that is no margin is of one value, or nobody can tell
        return -math.inf
    bins = np.clip((values - low) / width, 0, LAST).astype(np.intp)
    split = low + (otsu_byte(np.bincount(bins, minlength=LAST + 1).astype(float).tolist()) + 1) * width
    within = np.clip(values, low, high)
    empty, full = within[values < split], within[values >= split]
    if not empty.size or not full.size:
        return -math.inf
    below, above = (math.fsum(part.tolist()) / part.size for part in (empty, full))
    return below + OBJECT * (above - below)
