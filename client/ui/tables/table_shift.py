"""Tables pushed along the axis that density indexes, there and back without loss."""

from __future__ import annotations

import msgspec

from volsplat.client.ui.tables.table_edits import shifted
from volsplat.client.ui.viewing.scene_model import MOST_UNDONE
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Field, Tables

replace = msgspec.structs.replace
_DIGITS = 9  # of a share of the axis: pushes that cancel each other out are none


def by_density(scene: Scene) -> tuple[str, ...]:
    """The tables that density indexes."""
    return tuple(which for which in Tables.__struct_fields__ if getattr(scene.cross_bar, which) is Field.DENSITY)


class TableShift:
    """What one person's pushes add up to.

    What leaves the axis is cut off; the tables are taken from where the first push began, so that it comes back. So
    they are after an undo, and for as long as nobody changes the tables otherwise.
    """

    def __init__(self) -> None:
        self._begun: Tables | None = None  # of the push that is under way,
        self._by = 0.0  # and how far they had been pushed before it, as a share of the axis
        self._made: Tables | None = None  # by it so far
        self._known: dict[
            tuple[Tables, tuple[str, ...]], tuple[Tables, float]
        ] = {}  # what pushes have made, and of what

    def pushed(self, scene: Scene, by: float, settled: bool) -> Scene:
        """The scene with the tables moved by a share of the axis from where this push began; it ends if `settled`."""
        moved = by_density(scene)
        if self._begun is None or scene.tables != self._made:
            self._begun, self._by = self._known.get((scene.tables, moved), (scene.tables, 0.0))
        total = round(self._by + by, _DIGITS)
        tables = {which: shifted(getattr(self._begun, which), total) for which in moved}
        self._made = replace(scene.tables, **tables)
        if settled:
            self._remember(self._made, moved, self._begun, total)
            self._begun = None
        return replace(scene, tables=self._made)

    def _remember(self, made: Tables, moved: tuple[str, ...], begun: Tables, by: float) -> None:
        self._known[made, moved] = (begun, by)
        if len(self._known) > MOST_UNDONE:
            del self._known[next(iter(self._known))]
