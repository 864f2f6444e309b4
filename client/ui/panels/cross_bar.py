"""The cross-bar on the page: which field indexes which table."""

from __future__ import annotations

from nicegui import context, ui

from volsplat.client.ui.controls.controls import SceneEditor, show_prop
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS, TABLE_WORDS, TABLES, why_unused
from volsplat.protocol.description.shading_tables import Field

ALONE = (Field.DENSITY, Field.STRENGTH)  # the others come in groups of three
GROUPS = {"gradient": Field.GRADIENT_I, "screen": Field.SCREEN_X, "grid": Field.GRID_I}  # and with which each begins


def cross_bar(editor: SceneEditor, viewing: Viewing) -> None:
    """For each table a line with its name, then a wire for each field."""
    description = viewing.volume.description
    names = {Field.DENSITY: description.density_name, Field.STRENGTH: description.strength_name}
    called = {field: names.get(field, field.value.replace("-", " ")) for field in Field}
    with ui.element("div").classes("vs-cross-bar"):
        _heads(called)
        for table in TABLE_WORDS:
            _table_row(editor, table, called)


def _heads(called: dict[Field, str]) -> None:
    """What the columns are; each wire says it in full."""
    with ui.element("div").classes("vs-wires vs-wire-groups").props("aria-hidden=true"):
        for group in ("", *GROUPS):
            ui.label(group)
    with ui.element("div").classes("vs-wires vs-wire-heads").props("aria-hidden=true"):
        for field in Field:
            short = called[field].removeprefix("gradient ")[:3] if field in ALONE else field.value[-1]
            ui.label(short).tooltip(called[field])


def _table_row(editor: SceneEditor, table: str, called: dict[Field, str]) -> None:
    with ui.element("div").classes("vs-wire-name"):
        head = ui.label(TABLE_WORDS[table]).tooltip(TABLES[table])
        by = ui.label().classes("vs-muted")
    wired, wires = KEYS[f"cross_bar.{table}"], {}
    with ui.element("div").classes("vs-wires").props(f'role=radiogroup aria-label="{TABLE_WORDS[table]} by"'):
        for field, name in called.items():
            wire = ui.element("input").classes("vs-wire" + (" vs-first" if field in GROUPS.values() else ""))
            wire.props(f'type=radio name="{table} {context.client.id}"')
            wire.props["aria-label"] = wire.props["title"] = f"{TABLE_WORDS[table]} by {name}"
            wire.on("change", lambda field=field: editor.change(lambda scene: wired.put(scene, field)))
            wires[field] = wire

    def show(scene: Scene) -> None:
        for field, wire in wires.items():
            show_prop(wire, "checked", field == wired.of(scene))
        by.set_text(f"by {called[wired.of(scene)]}")
        idle = bool(why_unused(table, scene))
        for element in (head, *wires.values()):
            element.classes(add="vs-idle" if idle else "", remove="" if idle else "vs-idle")

    editor.follow(show)
