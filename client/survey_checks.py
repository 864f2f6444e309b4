"""What a server says of its sub-cubes' values, checked before anything is decided by it."""

import math
from array import array

from volsplat.protocol.errors import RemoteProtocolError
from volsplat.protocol.index_rules import HISTOGRAM_BINS, Survey


def check_survey(survey: Survey, voxels: int) -> None:
    """Raises RemoteProtocolError for a survey that cannot be one of so many voxels."""
    if survey.voxels != voxels or not 0 <= survey.no_data <= voxels:
        raise RemoteProtocolError(
            f"it surveyed {survey.voxels} voxels, {survey.no_data} of them without data, but its boxes have {voxels}"
        )
    if math.isnan(survey.low) or math.isnan(survey.high) or not survey.max_gradient >= 0.0:
        raise RemoteProtocolError(
            f"its values go from {survey.low} to {survey.high} and their gradients to {survey.max_gradient}"
        )


def check_counts(payload: memoryview, voxels: int) -> None:
    """Raises RemoteProtocolError for histograms that cannot be those of so many voxels."""
    counts = array("q", payload.tobytes())
    for scalar, counted in (("density", counts[:HISTOGRAM_BINS]), ("strength", counts[HISTOGRAM_BINS:])):
        if min(counted) < 0 or sum(counted) > voxels:
            raise RemoteProtocolError(
                f"its histogram of {scalar} counts {sum(counted)} voxels, the least bin {min(counted)}, but its boxes "
                f"have {voxels}"
            )
