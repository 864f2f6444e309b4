"""From where the volume is seen: its sides, what stands up, turns and fits, and the centre of the image."""

from __future__ import annotations

from functools import partial

import msgspec
from nicegui import ui

from volsplat.client.scene.view_sides import STANDPOINTS, sides
from volsplat.client.ui.controls.controls import SceneEditor, choose, pressable, show_pressed
from volsplat.client.ui.controls.key_controls import menu
from volsplat.client.ui.controls.text_field import number_field
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.volume.surveyed_volume import asking_for_fit
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS
from volsplat.protocol.description.view_rotation import Quaternion, about, named_view, product
from volsplat.protocol.geometry.upright import UPS
from volsplat.protocol.rules.resolved_view import resolved_center

ROLL_DEGREES = 15.0
ROTATION, UP, CENTER = KEYS["view.rotation"], KEYS["view.up"], KEYS["view.center"]


def side_buttons(editor: SceneEditor, viewing: Viewing) -> None:
    """A button for each side of the volume, which says what lies there."""
    volume = viewing.volume
    tooltips = {}
    with ui.element("div").classes("vs-buttons"):
        for side in STANDPOINTS:
            button = ui.button(side, color=None, on_click=partial(_turn, editor, named_view(side)))
            with button.props("dense flat no-caps"):
                tooltips[side] = ui.tooltip()

    def show(scene: Scene) -> None:
        for side, seen in sides(volume.description, volume.up_in(scene)).items():
            tooltips[side].set_text(f"seen from {seen.words}")

    editor.follow(show)


def up_menu(editor: SceneEditor, viewing: Viewing) -> None:
    """Which axis stands up."""
    told = viewing.volume.stands_up
    options = {"auto": f"by itself ({told.up})"} | {str(up): str(up) for up in UPS}
    choose(editor, menu("up", options, f"by itself {told.up}, {told.why}"), UP.of, UP.put)


def move_buttons(editor: SceneEditor, viewing: Viewing) -> None:
    """What is done to the view at once."""

    def reset(scene: Scene) -> Scene:
        return msgspec.structs.replace(
            scene, view=msgspec.structs.replace(viewing.default_scene.view, up=scene.view.up)
        )

    def roll(degrees: float) -> None:
        _turn(editor, product(about(2, degrees), editor.scene.view.rotation))

    moves = {
        "reset": ("the view at the beginning", partial(editor.change, reset)),
        "fit": ("all that is visible, from this side", partial(editor.change, asking_for_fit)),
        "roll left": ("counter-clockwise", partial(roll, ROLL_DEGREES)),
        "roll right": ("clockwise", partial(roll, -ROLL_DEGREES)),
    }
    with ui.element("div").classes("vs-buttons"):
        for name, (meaning, move) in moves.items():
            ui.button(name, color=None, on_click=move).props("dense flat no-caps").tooltip(meaning)


def _turn(editor: SceneEditor, rotation: Quaternion) -> None:
    editor.change(lambda scene: ROTATION.put(scene, rotation))


def center_fields(editor: SceneEditor, viewing: Viewing) -> None:
    """The grid point in the image's middle."""
    geometry = viewing.volume.description.geometry

    def get(axis: int, scene: Scene) -> float:
        return resolved_center(scene, geometry)[axis]

    def put(axis: int, scene: Scene, value: float) -> Scene:
        center = list(resolved_center(scene, geometry))
        center[axis] = value
        return CENTER.put(scene, tuple(center))

    with ui.element("div").classes("vs-row"):
        ui.label("centre of the image, grid").classes("vs-label")
        ui.element("div").classes("vs-spread")
        middle = pressable("middle", lambda: editor.change(lambda scene: CENTER.put(scene, "middle")))
    with ui.element("div").classes("vs-row vs-fields"):
        for axis, letter in enumerate("ijk"):
            field = number_field(editor, f"centre {letter}", partial(get, axis), partial(put, axis))
            field.props(f'prefix="{letter}"')
    editor.follow(lambda scene: show_pressed(middle, CENTER.of(scene) == "middle"))
