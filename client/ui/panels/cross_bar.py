"""The cross-bar on the page: which field indexes which table."""

from __future__ import annotations

from nicegui import context, ui

from volsplat.client.ui.controls.controls import SceneEditor, show_prop
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Field, Scene
from volsplat.protocol.description.scene_keys import KEYS, TABLES, why_unused

HEADS = {Field.DENSITY: "dens.", Field.STRENGTH: "stren."}  # of the columns; the others have a group and a letter
GROUPS = ("gradient", "screen", "grid")


def cross_bar(editor: SceneEditor, viewing: Viewing) -> None:
    """A wire for each table and field."""
    description = viewing.volume.description
    names = {Field.DENSITY: description.density_name, Field.STRENGTH: description.strength_name}
    with ui.element("div").classes("vs-cross-bar"):
        for column, field in enumerate(HEADS):
            ui.label(HEADS[field]).classes("vs-head-low").style(f"grid-column: {column + 2}").tooltip(names[field])
        for group, head in enumerate(GROUPS):
            ui.label(head).classes("vs-head-group").style(f"grid-column: {3 * group + 4} / span 3")
        for column, field in list(enumerate(Field))[len(HEADS) :]:
            letter = ui.label(field.value[-1]).style(f"grid-column: {column + 2}")
            letter.classes("vs-head-low" + (" vs-first" if _begins_group(field) else ""))
        for row, table in enumerate(TABLES):
            _cross_bar_row(editor, table, names, row + 3)


def _cross_bar_row(editor: SceneEditor, table: str, names: dict[Field, str], row: int) -> None:
    head = ui.label(table).classes("vs-head-row").style(f"grid-row: {row}").tooltip(TABLES[table])
    wired = KEYS[f"cross_bar.{table}"]
    wires = {}
    for field in Field:
        wire = (
            ui.element("input")
            .classes("vs-wire" + (" vs-first" if _begins_group(field) else ""))
            .style(f"grid-row: {row}")
        )
        wire.props(f'type=radio name="{table} {context.client.id}"')
        wire.props["aria-label"] = wire.props["title"] = f"{table} by {names.get(field, field.value.replace('-', ' '))}"
        wire.on("change", lambda field=field: editor.change(lambda scene: wired.put(scene, field)))
        wires[field] = wire

    def show(scene: Scene) -> None:
        for field, wire in wires.items():
            show_prop(wire, "checked", field == wired.of(scene))
        idle = bool(why_unused(table, scene))
        for element in (head, *wires.values()):
            element.classes(add="vs-idle" if idle else "", remove="" if idle else "vs-idle")

    editor.follow(show)


def _begins_group(field: Field) -> bool:
    return field in (Field.GRADIENT_I, Field.SCREEN_X, Field.GRID_I)
