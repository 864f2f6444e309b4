"""The shading rules on the page: which field indexes which table, what light does, and where it comes from."""

from __future__ import annotations

import math
from typing import Literal

import msgspec
from nicegui import context, ui

from volsplat.client.ui.controls.controls import TOGGLE_PROPS, SceneEditor, choose, show_prop
from volsplat.client.ui.controls.light_ball import LightBall
from volsplat.client.ui.controls.slider import Slider
from volsplat.client.ui.controls.text_field import number_field
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import CrossBar, Field, Light, Scene, Shading
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.frame_plan import screen_rotation

TABLES = {
    "emit": "emitted colour",
    "refl": "reflected colour",
    "opac": "opacity",
    "modu": "modulation of the opacity",
}
HEADS = {Field.DENSITY: "dens.", Field.STRENGTH: "stren."}  # of the columns; the others have a group and a letter
GROUPS = ("gradient", "screen", "grid")
SWITCHES = {
    "emitted": "emitted",
    "diffuse": "diffuse",
    "specular": "specular",
    "modulation": "modulation",
    "two_sided": "two-sided",
}
POWER_POSITIONS = (0.0, 3.0)  # of the slider: the power's logarithm to the base 10

replace = msgspec.structs.replace


def shading_panel(viewing: Viewing) -> None:
    """The cross-bar, the switches, the specular power and the light."""
    description = viewing.volume.description
    editor = SceneEditor(viewing.model, description.geometry, "shading")
    with ui.element("section").classes("vs-panel").props('aria-label="shading"'):
        ui.label("Shading").classes("vs-title")
        _cross_bar(editor, description)
        with ui.element("div").classes("vs-switches"):
            for name, label in SWITCHES.items():
                _switch(editor, name, label)
        _specular_power(editor)
        _light(editor)


def _cross_bar(editor: SceneEditor, description: VolumeDescription) -> None:
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
    wires = {}
    for field in Field:
        wire = (
            ui.element("input")
            .classes("vs-wire" + (" vs-first" if _begins_group(field) else ""))
            .style(f"grid-row: {row}")
        )
        wire.props(f'type=radio name="{table} {context.client.id}"')
        wire.props["aria-label"] = wire.props["title"] = f"{table} by {names.get(field, field.value.replace('-', ' '))}"
        wire.on("change", lambda field=field: editor.change(lambda scene: _wired(scene, table, field)))
        wires[field] = wire

    def show(scene: Scene) -> None:
        for field, wire in wires.items():
            show_prop(wire, "checked", field == getattr(scene.cross_bar, table))
        idle = not _has_effect(table, scene.shading)
        for element in (head, *wires.values()):
            element.classes(add="vs-idle" if idle else "", remove="" if idle else "vs-idle")

    editor.follow(show)


def _begins_group(field: Field) -> bool:
    return field in (Field.GRADIENT_I, Field.SCREEN_X, Field.GRID_I)


def _wired(scene: Scene, table: str, field: Field) -> Scene:
    cross_bar: CrossBar = replace(scene.cross_bar, **{table: field})
    return replace(scene, cross_bar=cross_bar)


def _has_effect(table: str, shading: Shading) -> bool:
    """Whether the switches leave the table anything to do."""
    return {
        "emit": shading.emitted,
        "refl": shading.diffuse or shading.specular,
        "opac": True,
        "modu": shading.modulation,
    }[table]


def _switch(editor: SceneEditor, name: str, label: str) -> None:
    choose(
        editor,
        ui.switch(label).props("dense").classes("vs-switch"),
        lambda scene: getattr(scene.shading, name),
        lambda scene, on: replace(scene, shading=replace(scene.shading, **{name: on})),
    )


def _specular_power(editor: SceneEditor) -> None:
    def powered(scene: Scene, power: float) -> Scene:
        return replace(scene, shading=replace(scene.shading, specular_power=power))

    low, high = POWER_POSITIONS
    with ui.element("div").classes("vs-row"):
        ui.label("specular power").classes("vs-label")
        Slider(
            editor,
            "specular power",
            POWER_POSITIONS,
            0.01,
            lambda scene: round(min(high, max(low, math.log10(scene.shading.specular_power))), 2),
            lambda scene, position: powered(scene, float(f"{10**position:.3g}")),
        )
        field = number_field(editor, "specular power, a number", lambda scene: scene.shading.specular_power, powered)
        field.classes("vs-short")


def _light(editor: SceneEditor) -> None:
    def turned(direction: Vector, settled: bool) -> None:
        editor.change(lambda scene: _lit_from(scene, direction), settled=settled)

    def to_other_side() -> None:
        x, y, z = screen_direction(editor.scene)
        turned((x, y, -z), True)

    with ui.element("div").classes("vs-light"):
        ball = LightBall(turned)
        with ui.element("div").classes("vs-light-words"):
            ui.label("light fixed to").classes("vs-label")
            fixed_to = ui.toggle(["world", "grid"]).props(TOGGLE_PROPS).classes("vs-toggle")
            choose(editor, fixed_to, lambda scene: scene.light.fixed_to, light_fixed_to)
            words = ui.label().classes("vs-muted")
            side = ui.button(on_click=to_other_side).props("dense flat no-caps").classes("vs-quiet-button")

    def show(scene: Scene) -> None:
        direction = screen_direction(scene)
        ball.show(tuple(round(part, 4) for part in direction))  # type: ignore[arg-type]
        words.set_text(light_words(direction))
        side.set_text("bring it in front" if direction[2] < 0 else "put it behind")

    editor.follow(show)


def screen_direction(scene: Scene) -> Vector:
    """Where the light comes from along screen axes, at length 1."""
    direction = matrices.normalised(scene.light.direction)
    if scene.light.fixed_to == "grid":
        direction = matrices.applied(screen_rotation(scene.view), direction)
    return direction


def _lit_from(scene: Scene, direction: Vector) -> Scene:
    """The scene with its light where `direction` along screen axes points, fixed to what it was fixed to."""
    if scene.light.fixed_to == "grid":
        direction = matrices.applied(matrices.transposed(screen_rotation(scene.view)), direction)
    return replace(scene, light=replace(scene.light, direction=direction))


def light_fixed_to(scene: Scene, fixed_to: Literal["world", "grid"]) -> Scene:
    """The scene with its light fixed to something else, where it stands now."""
    direction = screen_direction(scene)
    return _lit_from(replace(scene, light=Light(direction=direction, fixed_to=fixed_to)), direction)


def light_words(direction: Vector) -> str:
    """Where the light stands, roughly, for a person."""
    x, y, z = direction
    words = [word for amount, word in ((abs(y), "above" if y > 0 else "below"),) if amount > 0.25]
    words += [word for amount, word in ((abs(x), "right" if x > 0 else "left"),) if amount > 0.25]
    words.append("behind" if z < 0 else "in front")
    return ", ".join(words)
