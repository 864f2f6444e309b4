"""The light on the page: where it comes from, and what it is fixed to."""

from __future__ import annotations

from typing import Literal

import msgspec
from nicegui import ui

from volsplat.client.ui.controls.controls import TOGGLE_PROPS, SceneEditor, choose
from volsplat.client.ui.controls.light_ball import LightBall
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.resolved_view import screen_rotation

replace = msgspec.structs.replace


def light_controls(editor: SceneEditor, _viewing: Viewing) -> None:
    """A ball to drag the light on, what it is fixed to, and where it stands, in words."""

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
    return _lit_from(replace(scene, light=replace(scene.light, fixed_to=fixed_to)), direction)


def light_words(direction: Vector) -> str:
    """Where the light stands, roughly, for a person."""
    x, y, z = direction
    words = [word for amount, word in ((abs(y), "above" if y > 0 else "below"),) if amount > 0.25]
    words += [word for amount, word in ((abs(x), "right" if x > 0 else "left"),) if amount > 0.25]
    words.append("behind" if z < 0 else "in front")
    return ", ".join(words)
