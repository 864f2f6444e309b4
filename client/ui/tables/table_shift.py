"""Tables pushed along the axis that density indexes, there and back without loss."""

from __future__ import annotations

import msgspec

from volsplat.client.ui.tables.table_edits import shifted
from volsplat.client.ui.viewing.known_pushes import KnownPushes
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Field, Tables

replace = msgspec.structs.replace
_DIGITS = 9  # of a share of the axis: pushes that cancel each other out are none


def by_density(scene: Scene) -> tuple[str, ...]:
    """The tables that density indexes."""
    return tuple(which for which in Tables.__struct_fields__ if getattr(scene.cross_bar, which) is Field.DENSITY)


class TableShift:
    """What the pushes of one tab's hand add up to, with those before them in whichever tab.

    What leaves the axis is cut off; the tables are taken from where the first push began, so that it comes back. So
    they are after an undo, and for as long as nobody changes the tables otherwise.
    """

    def __init__(self, known: KnownPushes) -> None:
        self._known = known
        self._begun: Tables | None = None  # of the push that is under way,
        self._by = 0.0  # and how far they had been pushed before it, as a share of the axis
        self._made: Tables | None = None  # by it so far

    def pushed(self, scene: Scene, by: float, settled: bool) -> Scene:
        """The scene with the tables moved by a share of the axis from where this push began; it ends if `settled`."""
        moved = by_density(scene)
        if self._begun is None or scene.tables != self._made:
            self._begun, self._by = self._known.begun((scene.tables, moved))
        total = round(self._by + by, _DIGITS)
        tables = {which: shifted(getattr(self._begun, which), total) for which in moved}
        self._made = replace(scene.tables, **tables)
        self._known.note((self._made, moved), (self._begun, total), settled)
        if settled:
            self._begun = None
        return replace(scene, tables=self._made)
