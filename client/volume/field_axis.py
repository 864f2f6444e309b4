"""What a field that indexes a table stands for: its axis, in the data's own units."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.shading_tables import GRID_FIELDS, TABLE_ENTRIES, Field
from volsplat.protocol.rules.resolved_view import bounding_radius

LAST = TABLE_ENTRIES - 1
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


def field_axis(volume: SurveyedVolume, field: Field, quantise: Quantise) -> FieldAxis:
    """The axis of a table that this field indexes (index_rules has the bytes)."""
    description = volume.description
    if field is Field.DENSITY:
        return FieldAxis(field, description.density_name, *volume.quantisation(quantise).window, description.value_unit)
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
