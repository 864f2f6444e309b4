"""The means of up to 2x2x2 voxels that make the next coarser level, and what stands for their second scalar."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.levels import dims_at_level

ALL_AXES: Index = (2, 2, 2)
SHEETS_AT_A_TIME = 16  # so that sums take little memory beside the source


def mean_type(scalar_type: str) -> str:
    """What means are kept in: float32 if that loses nothing worth keeping, else float64."""
    kind = np.dtype(scalar_type)
    return "float32" if kind.itemsize <= 2 or kind == np.float32 else "float64"


def halved(values: Voxels, factors: Index = ALL_AXES) -> NDArray[Any]:
    """Each voxel the mean of the finite ones among `factors`, 1 or 2 along i, j, k; NaN where there is none.

    At an odd end it is of what is there. `values` (k, j, i) must begin at even indices of the volume, and end so or
    where the volume ends.
    """
    means = np.empty(halved_shape(values.shape, factors), mean_type(values.dtype.name))
    for k in range(0, len(values), SHEETS_AT_A_TIME):
        means[halved_sheets(k, factors)] = _means(values[k : k + SHEETS_AT_A_TIME], factors)
    return means


def halved_shape(shape: Sequence[int], factors: Index) -> tuple[int, int, int]:
    """Of an array (k, j, i)."""
    k, j, i = shape
    return dims_at_level((k, j, i), factors[::-1])


def halved_sheets(k: int, factors: Index, count: int = SHEETS_AT_A_TIME) -> slice:
    """Where the means of `count` sheets lie that begin at k, both even."""
    return slice(k // factors[2], (k + count) // factors[2])


def halved_second(values: Voxels, second: Voxels, factors: Index = ALL_AXES) -> Voxels:
    """Each voxel the second scalar of that one among `factors` whose value is the greatest, the first of equals.

    The numbers of a phase, which is cyclic, have no mean, and nobody says whether this is one; what a voxel had is
    right for any. Both are shaped as for `halved`.
    """
    chosen = np.empty(halved_shape(second.shape, factors), second.dtype)
    for k in range(0, len(second), SHEETS_AT_A_TIME):
        sheets = slice(k, k + SHEETS_AT_A_TIME)
        exact = values[sheets].astype(np.float64)
        ranks = np.where(np.isfinite(exact), exact, -np.inf)
        chosen[halved_sheets(k, factors)] = _of_greatest(ranks, second[sheets], factors)
    return chosen


def _of_greatest(ranks: NDArray[np.float64], second: Voxels, factors: Index) -> Voxels:
    """Along i, then j, then k, so that of equals the first in memory is taken."""
    for axis in (2, 1, 0):
        if factors[2 - axis] == 1:
            continue
        along = (slice(None),) * axis
        end = ranks.shape[axis] // 2 * 2
        one, other, rest = ((*along, part) for part in (slice(0, end, 2), slice(1, end, 2), slice(end, None)))
        greater = ranks[other] > ranks[one]
        ranks, second = (
            np.concatenate([np.where(greater, both[other], both[one]), both[rest]], axis) for both in (ranks, second)
        )
    return second


def _means(values: Voxels, factors: Index) -> NDArray[np.float64]:
    if values.dtype.kind in "iu" and values.dtype.itemsize <= 2:
        means: NDArray[np.float64] = sums(values.astype(np.int32), factors) / _counts(values.shape, factors)
        return means
    exact = values.astype(np.float64)
    has_value = np.isfinite(exact)
    counts = _counts(values.shape, factors)
    if not has_value.all():
        exact = np.where(has_value, exact, 0.0)
        counts = sums(has_value.astype(np.float64), factors)
        counts[counts == 0] = np.nan
    means = sums(exact, factors) / counts
    return means


def _counts(shape: tuple[int, ...], factors: Index) -> NDArray[Any]:
    """How many voxels each mean is of."""
    k, j, i = (
        np.minimum(n - np.arange(0, n, factor), factor) for n, factor in zip(shape, reversed(factors), strict=True)
    )
    return k[:, None, None] * j[None, :, None] * i[None, None, :]


def sums(values: NDArray[Any], factors: Index) -> NDArray[Any]:
    """Over so many voxels: along k, then j, then i."""
    for axis in range(3):
        if factors[2 - axis] == 1:
            continue
        pairs = values.shape[axis] // 2 * 2
        along = (slice(None),) * axis
        sums = values[(*along, slice(0, pairs, 2))] + values[(*along, slice(1, pairs, 2))]
        values = np.concatenate([sums, values[(*along, slice(pairs, None))]], axis) if values.shape[axis] % 2 else sums
    return values
