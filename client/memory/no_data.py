"""Masked numbers, as numpy and netCDF have them, become NaN, which is never drawn."""

from __future__ import annotations

from typing import Any

import numpy as np


def with_nan(dtype: Any) -> Any:
    """The least type of floating point that holds these numbers, or nearly, and has NaN beside them."""
    return np.result_type(dtype, np.float32)


class NetcdfValues:
    """A variable as netCDF4 decodes it, scaled and masked; only what is asked for is read."""

    def __init__(self, variable: Any) -> None:
        self._variable = variable
        self.shape = tuple(variable.shape)
        corner = variable[(slice(0, 1),) * variable.ndim]  # the file's own type is not that of scaled numbers
        self.dtype = with_nan(corner.dtype)

    def __getitem__(self, part: Any) -> Any:
        return np.ma.filled(self._variable[part].astype(self.dtype), np.nan)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.asarray(self[:], dtype)
