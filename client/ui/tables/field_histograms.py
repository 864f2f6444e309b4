"""The data's histogram of each packet field that can index a table, over its 256 entries, and the field's axis."""

from __future__ import annotations

import math
from dataclasses import dataclass

from volsplat.client.histogram.density_histogram import DensityHistogram, density_histogram
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import TABLE_ENTRIES, Field, Quantise
from volsplat.protocol.rules.resolved_view import bounding_radius

LAST = TABLE_ENTRIES - 1
GRID_FIELDS = (Field.GRID_I, Field.GRID_J, Field.GRID_K)
SCREEN_FIELDS = {
    Field.SCREEN_X: "screen x, to the right",
    Field.SCREEN_Y: "screen y, upwards",
    Field.SCREEN_Z: "screen z, to the viewer",
}


@dataclass(frozen=True)
class FieldAxis:
    """What a field's byte means: position 0 of a table stands for `low`, position 1 for `high`."""

    field: Field
    label: str
    low: float
    high: float
    unit: str = ""


def density_counts(volume: SurveyedVolume, quantise: Quantise) -> DensityHistogram:
    """How many voxels have each density byte under the scene's window. Raises BadInput for one without a scale."""
    return density_histogram(volume.survey, volume.density_counts, volume.quantisation(quantise).window)


def strength_counts(volume: SurveyedVolume) -> tuple[int, ...]:
    """How many voxels have each byte of strength, under the one scale of the whole volume."""
    counts = volume.strength_counts
    low, high = volume.strength_range
    scale_of_bins = (high - low) / len(counts) * volume.strength_scale
    result = [0] * TABLE_ENTRIES
    for n, count in enumerate(counts):
        if count:
            result[math.floor(min((n + 0.5) * scale_of_bins, LAST) + 0.5)] += count
    return tuple(result)


def field_histogram(volume: SurveyedVolume, field: Field, quantise: Quantise) -> tuple[int, ...] | None:
    """256 counts of voxels; None for a field that is not a matter of the data: a direction or a place."""
    match field:
        case Field.DENSITY:
            return density_counts(volume, quantise).counts
        case Field.STRENGTH:
            return strength_counts(volume)
    return None


def field_axis(volume: SurveyedVolume, field: Field, quantise: Quantise) -> FieldAxis:
    """The axis of a table that this field indexes, in the data's own units (index_rules has the bytes)."""
    description = volume.description
    if field is Field.DENSITY:
        return FieldAxis(field, description.density_name, *volume.quantisation(quantise).window)
    if field is Field.STRENGTH:
        low, scale = volume.strength_range[0], volume.strength_scale
        return FieldAxis(field, description.strength_name, low, low + LAST / scale if scale > 0 else 1.0)
    if field in GRID_FIELDS:
        size = description.geometry.dims[GRID_FIELDS.index(field)]
        return FieldAxis(field, f"grid {field.value[-1]}", 0.0, size * LAST / TABLE_ENTRIES)
    if field in SCREEN_FIELDS:
        radius = bounding_radius(description.geometry)
        last = radius * (2 * LAST / TABLE_ENTRIES - 1)
        return FieldAxis(field, SCREEN_FIELDS[field], -radius, last, description.unit)
    return FieldAxis(field, f"gradient direction along {field.value[-1]}", -128 / 127, 1.0)
