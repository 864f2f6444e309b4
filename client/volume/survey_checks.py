"""What a server says of its sub-cubes' values, checked before anything is decided by it."""

import math

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.block_extremes import BLOCK_BYTES, block_dims
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.text.errors import RemoteProtocolError


def check_survey(survey: Survey, voxels: int) -> None:
    """Raises RemoteProtocolError for a survey that cannot be one of so many voxels."""
    if survey.voxels != voxels or not 0 <= survey.no_data <= voxels:
        raise RemoteProtocolError(
            f"it surveyed {survey.voxels} voxels, {survey.no_data} of them without data, but its boxes have {voxels}"
        )
    if survey.counted is not None:
        raise RemoteProtocolError("it tells of ranges of histograms that nobody has counted yet")
    if math.isnan(survey.low) or math.isnan(survey.high) or not survey.max_gradient >= 0.0:
        raise RemoteProtocolError(
            f"its values go from {survey.low} to {survey.high} and their gradients to {survey.max_gradient}"
        )


def check_counts(payload: memoryview, voxels: int) -> None:
    """Raises RemoteProtocolError for histograms that cannot be those of so many voxels."""
    counts = np.frombuffer(payload, np.int64).reshape(2, HISTOGRAM_BINS)
    for scalar, counted in zip(("density", "strength"), counts, strict=True):
        total, least = _sum(counted), int(counted.min())
        if least < 0 or total > voxels:
            raise RemoteProtocolError(
                f"its histogram of {scalar} counts {total} voxels, the least bin {least}, but its boxes have {voxels}"
            )


def _sum(counts: NDArray[np.int64]) -> int:
    """Of any numbers: the sums of their halves fit into 64 bits."""
    return (int((counts >> 32).sum()) << 32) + int((counts & 0xFFFFFFFF).sum())


def check_extremes(payload: memoryview, dims: Index) -> None:
    """Raises RemoteProtocolError for what cannot be the extremes of the blocks of a volume of these dimensions."""
    blocks = math.prod(block_dims(dims))
    if payload.nbytes != BLOCK_BYTES * blocks:
        raise RemoteProtocolError(f"it told of {payload.nbytes // BLOCK_BYTES} blocks, but the volume has {blocks}")
    if np.isnan(np.frombuffer(payload, np.float64)).any():
        raise RemoteProtocolError("it told of a block whose least or greatest value is not a number")
