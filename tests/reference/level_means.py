"""The next coarser level of a volume in plain torch: means of 2x2x2 values, and the second scalar of one of them."""

from itertools import product

import torch
from torch import Tensor

from reference.voxel_packets import with_no_data_as_nan


def halved(values: Tensor) -> Tensor:
    """float64 means of the finite ones of 2x2x2 values (k, j, i), NaN where there is none."""
    values = with_no_data_as_nan(values)
    k, j, i = ((n + 1) // 2 * 2 for n in values.shape)
    even = torch.full((k, j, i), torch.nan, dtype=torch.float64)
    even[: values.shape[0], : values.shape[1], : values.shape[2]] = values
    return even.reshape(k // 2, 2, j // 2, 2, i // 2, 2).nanmean(dim=(1, 3, 5))


def strongest(values: Tensor, second: Tensor) -> Tensor:
    """The second scalar of that voxel of 2x2x2 whose value is the greatest, the first of equals along k, j, i."""
    values = with_no_data_as_nan(values)
    chosen = second[::2, ::2, ::2].clone()
    greatest = torch.full(chosen.shape, -torch.inf, dtype=torch.float64)
    for dk, dj, di in product((0, 1), repeat=3):
        corner = values[dk::2, dj::2, di::2]
        there = tuple(slice(0, n) for n in corner.shape)
        greater = corner > greatest[there]
        greatest[there] = torch.where(greater, corner, greatest[there])
        chosen[there] = torch.where(greater, second[dk::2, dj::2, di::2], chosen[there])
    return chosen
