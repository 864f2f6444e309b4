"""The table editor as an element of a page: one table over the histogram of the field that indexes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.doors.static_files import MODULES
from volsplat.client.ui.tables.scene_tables import IndexedBy
from volsplat.client.ui.tables.table_edits import Table, table_from_points
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.text.errors import BadInput


class TableEditor(Element, component="table_editor_component.js", esm=MODULES):
    """Shows a table, and tells of what a person does to it.

    `on_change(table, settled)` and `on_file(name, text)` may raise ValueError or BadInput, which is told at the table.
    """

    def __init__(
        self,
        name: str,
        table: Table,
        field: IndexedBy,
        on_change: Callable[[Table, bool], None],
        on_file: Callable[[str, str], None],
    ) -> None:
        super().__init__()
        self.selected = -1  # the point that the person has picked
        self._on_change = on_change
        self._on_file = on_file
        self._field: IndexedBy | None = None
        self._answers = 0  # the number of the last change that came from this editor
        self._props.update(name=name, colour=isinstance(table, ColourTable))
        self._table = table
        self._props["shown"] = self._shown
        self.show_field(field)
        self.on("change", self._changed)
        self.on("select", self._selected)
        self.on("load", self._loaded)

    @property
    def table(self) -> Table:
        """As last shown."""
        return self._table

    def show_table(self, table: Table) -> None:
        """Show the scene's table, unless the person at this page is changing it.

        It may change with every move of a hand; NiceGUI would go over the whole page for that, so the browser is told
        by a call.
        """
        self._table = table
        with self._props.suspend_updates():
            self._props["shown"] = self._shown
        self.run_method("show", self._shown)

    @property
    def _shown(self) -> dict[str, object]:
        return {"points": self._table.points, "answers": self._answers}

    def show_field(self, field: IndexedBy) -> None:
        if field != self._field:
            self._field = field
            self._props.update(axis=asdict(field.axis), histogram=field.histogram, unused=field.unused, tint=field.tint)

    def complain(self, text: str) -> None:
        """Tell of bad input, at the table."""
        self.run_method("complain", text)

    def pick_file(self) -> None:
        """Have the person choose a table's file."""
        self.run_method("pickFile")

    def _changed(self, event: GenericEventArguments) -> None:
        change = event.args
        self._answers = int(change["number"])
        try:
            drawn = change["settled"] and change["freehand"]
            self._on_change(table_from_points(self._table, change["points"], drawn), bool(change["settled"]))
        except (BadInput, ValueError) as error:
            self.show_table(self._table)
            self.complain(str(error))

    def _selected(self, event: GenericEventArguments) -> None:
        self.selected = int(event.args)

    def _loaded(self, event: GenericEventArguments) -> None:
        try:
            self._on_file(str(event.args["name"]), str(event.args["text"]))
        except (BadInput, ValueError) as error:
            self.complain(str(error))
