"""The four tables of a scene, each with the field that indexes it."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import NamedTuple

import msgspec

from volsplat.client.ui.tables.field_histograms import field_histogram
from volsplat.client.ui.tables.table_edits import Table
from volsplat.client.volume.field_axis import FieldAxis, field_axis
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import TABLE_WORDS, why_unused

replace = msgspec.structs.replace


def table_of(scene: Scene, which: str) -> Table:
    """The table of that key of TABLE_WORDS."""
    table: Table = getattr(scene.tables, which)
    return table


def with_table(scene: Scene, which: str, table: Table) -> Scene:
    return replace(scene, tables=replace(scene.tables, **{which: table}))


class IndexedBy(NamedTuple):
    """The field whose values index a table, as its plot shows it."""

    axis: FieldAxis
    histogram: tuple[int, ...] | None
    unused: str = ""  # why the table changes nothing at present
    tint: str = ""  # the table over the same field whose colours the histogram's bars take


class IndexedFields:
    """The fields that index a scene's tables."""

    def __init__(self, volume: SurveyedVolume) -> None:
        self._volume = volume
        self._histogram = lru_cache(maxsize=8)(partial(field_histogram, volume))

    def of(self, scene: Scene, which: str) -> IndexedBy:
        field = getattr(scene.cross_bar, which)
        axis = field_axis(self._volume, field, scene.quantise)
        return IndexedBy(axis, self._histogram(field, scene.quantise), why_unused(which, scene), _tint(scene, which))


def _tint(scene: Scene, which: str) -> str:
    """Opacity tells how much is seen of which colour, if both are by the same field."""
    alike = which == "opac" and scene.cross_bar.opac is scene.cross_bar.refl
    return TABLE_WORDS["refl"] if alike and not why_unused("refl", scene) else ""
