"""What is known of a volume, for programs: `volsplat info --json`."""

import math
from collections.abc import Sequence
from typing import Any

import msgspec

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.volume_info import PERCENTILES, TitledPart
from volsplat.protocol.rules.index_rules import percentiles


def volume_facts(known: SurveyedVolume, parts: Sequence[TitledPart]) -> dict[str, Any]:
    """Plain values, as JSON has them. Where no voxel has a value, `range`, `percentiles` and `histogram` are null."""
    told, survey = known.description, known.survey
    geometry, empty = told.geometry, survey.low > survey.high
    shares = () if empty else PERCENTILES
    ranges = survey.ranges
    found = percentiles(known.density_counts, ranges.low, ranges.high, shares)
    cuts = {f"{share:.0%}": value for share, value in zip(shares, found, strict=True)}
    facts = {
        "name": told.name,
        "format": told.format,
        "kind": told.kind,
        "dims": geometry.dims,
        "spacing": geometry.spacing,
        "origin": geometry.origin,
        "index_to_physical": geometry.index_to_physical,
        "unit": told.unit or None,
        "anatomical": told.anatomical,
        "up": known.stands_up.up,
        "axes": told.axes,
        "classes": told.bands,
        "scalar_type": told.scalar_type,
        "value_unit": told.value_unit or None,
        "voxels": math.prod(geometry.dims),
        "no_data": survey.no_data,
        "range": None if empty else (survey.low, survey.high),
        "percentiles": cuts or None,
        "window": known.automatic_window,
        "histogram": None if empty else {"low": ranges.low, "high": ranges.high, "counts": known.density_counts},
        "levels": [level.dims for level in known.prepared.levels] if known.prepared is not None else None,
        "parts": [one._asdict() for one in parts],
        "notes": known.warnings(),
    }
    plain: dict[str, Any] = msgspec.to_builtins(facts)
    return plain
