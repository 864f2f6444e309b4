"""Tables pushed along the axis that density indexes, there and back without loss."""

from __future__ import annotations

import msgspec

from volsplat.client.ui.tables.table_edits import shifted
from volsplat.protocol.description.scene import Field, Scene, Tables

replace = msgspec.structs.replace
_DIGITS = 9  # of a share of the axis: pushes that cancel each other out are none


def by_density(scene: Scene) -> tuple[str, ...]:
    """The tables that density indexes."""
    return tuple(which for which in Tables.__struct_fields__ if getattr(scene.cross_bar, which) is Field.DENSITY)


class TableShift:
    """What one person's pushes add up to, until somebody changes the tables otherwise.

    What leaves the axis is cut off; the tables are taken from where the first push began, so that it comes back.
    """

    def __init__(self) -> None:
        self._begun: Tables | None = None
        self._moved: tuple[str, ...] = ()
        self._by = 0.0  # all pushes that have ended, as a share of the axis
        self._made: Tables | None = None

    def pushed(self, scene: Scene, by: float, settled: bool) -> Scene:
        """The scene with the tables moved by a share of the axis from where this push began; it ends if `settled`."""
        if self._begun is None or scene.tables != self._made or by_density(scene) != self._moved:
            self._begun, self._moved, self._by = scene.tables, by_density(scene), 0.0
        total = round(self._by + by, _DIGITS)
        moved = {which: shifted(getattr(self._begun, which), total) for which in self._moved}
        self._made = replace(scene.tables, **moved)
        if settled:
            self._by = total
        return replace(scene, tables=self._made)
