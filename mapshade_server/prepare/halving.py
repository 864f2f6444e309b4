"""The means of 2x2x2 voxels that make the next coarser level, and what stands for their second scalar."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels

SHEETS_AT_A_TIME = 16  # so that sums take little memory beside the source


def mean_type(scalar_type: str) -> str:
    """What means are kept in: float32 if that loses nothing worth keeping, else float64."""
    kind = np.dtype(scalar_type)
    return "float32" if kind.itemsize <= 2 or kind == np.float32 else "float64"


def halved(values: Voxels) -> NDArray[Any]:
    """Each voxel the mean of the finite ones among 2x2x2, NaN where there is none; at an odd end, of what is there.

    `values` (k, j, i) must begin at even indices of the volume, and end so or where the volume ends.
    """
    means = np.empty([(n + 1) // 2 for n in values.shape], mean_type(values.dtype.name))
    for k in range(0, len(values), SHEETS_AT_A_TIME):
        sheets = values[k : k + SHEETS_AT_A_TIME]
        means[k // 2 : (k + len(sheets) + 1) // 2] = _means(sheets)
    return means


def halved_second(values: Voxels, second: Voxels) -> Voxels:
    """Each voxel the second scalar of that one among 2x2x2 whose value is the greatest, the first of equals.

    The numbers of a phase, which is cyclic, have no mean, and nobody says whether this is one; what a voxel had is
    right for any. Both are shaped as for `halved`.
    """
    chosen = np.empty([(n + 1) // 2 for n in second.shape], second.dtype)
    for k in range(0, len(second), SHEETS_AT_A_TIME):
        sheets = slice(k, k + SHEETS_AT_A_TIME)
        exact = values[sheets].astype(np.float64)
        ranks = np.where(np.isfinite(exact), exact, -np.inf)
        chosen[k // 2 : (k + len(exact) + 1) // 2] = _of_greatest(ranks, second[sheets])
    return chosen


def _of_greatest(ranks: NDArray[np.float64], second: Voxels) -> Voxels:
    """Along i, then j, then k, so that of equals the first in memory is taken."""
    for axis in (2, 1, 0):
        along = (slice(None),) * axis
        end = ranks.shape[axis] // 2 * 2
        one, other, rest = ((*along, part) for part in (slice(0, end, 2), slice(1, end, 2), slice(end, None)))
        greater = ranks[other] > ranks[one]
        ranks, second = (
            np.concatenate([np.where(greater, both[other], both[one]), both[rest]], axis) for both in (ranks, second)
        )
    return second


def _means(values: Voxels) -> NDArray[np.float64]:
    if values.dtype.kind in "iu" and values.dtype.itemsize <= 2:
        means: NDArray[np.float64] = sums(values.astype(np.int32)) / _counts(values.shape)
        return means
    exact = values.astype(np.float64)
    has_value = np.isfinite(exact)
    counts = _counts(values.shape)
    if not has_value.all():
        exact = np.where(has_value, exact, 0.0)
        counts = sums(has_value.astype(np.float64))
        counts[counts == 0] = np.nan
    means = sums(exact) / counts
    return means


def _counts(shape: tuple[int, ...]) -> NDArray[Any]:
    """How many voxels each mean is of."""
    k, j, i = (np.where(np.arange((n + 1) // 2) < n // 2, 2, 1) for n in shape)
    return k[:, None, None] * j[None, :, None] * i[None, None, :]


def sums(values: NDArray[Any]) -> NDArray[Any]:
    """Over 2x2x2 voxels: along k, then j, then i."""
    for axis in range(3):
        pairs = values.shape[axis] // 2 * 2
        along = (slice(None),) * axis
        sums = values[(*along, slice(0, pairs, 2))] + values[(*along, slice(1, pairs, 2))]
        values = np.concatenate([sums, values[(*along, slice(pairs, None))]], axis) if values.shape[axis] % 2 else sums
    return values
