"""The data's histogram of each packet field that can index a table, over its 256 entries."""

from __future__ import annotations

import numpy as np

from volsplat.client.histogram.density_histogram import summed_by_byte
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.shading_tables import Field


def strength_counts(volume: SurveyedVolume) -> tuple[int, ...]:
    """How many voxels have each byte of strength, under the one scale of the whole volume."""
    counts = volume.strength_counts
    low, high = volume.strength_range
    scale_of_bins = (high - low) / len(counts) * volume.strength_scale
    return summed_by_byte((np.arange(len(counts)) + 0.5) * scale_of_bins, counts)


def field_histogram(volume: SurveyedVolume, field: Field, quantise: Quantise) -> tuple[int, ...] | None:
    """256 counts of voxels; None for a field that is not a matter of the data: a direction or a place."""
    match field:
        case Field.DENSITY:
            return volume.density_histogram(quantise).counts
        case Field.STRENGTH:
            return strength_counts(volume)
    return None
