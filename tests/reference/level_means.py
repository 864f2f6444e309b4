"""The next coarser level of a volume in plain torch: means of 2x2x2 source values."""

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
