"""The image's size on the page: as large as the window, or fixed."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.scene.resized import sized
from volsplat.client.ui.controls.controls import TOGGLE_PROPS, SceneEditor
from volsplat.client.ui.controls.text_field import whole_number_field
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene

CHOICES = {True: "follows the window", False: "fixed"}


def image_size_fields(editor: SceneEditor, viewing: Viewing) -> None:
    """Whether the image follows the window, and its width and height."""
    image_size = viewing.image_size

    def fix_or_follow(follows: bool) -> None:
        if follows == image_size.follows_window:
            return
        image_size.follows_window = follows
        editor.change(image_size.fitted)  # also if the size stays, for other tabs to show what was chosen

    with ui.element("div").classes("vs-row"):
        ui.label("size").classes("vs-label vs-narrow")
        toggle = ui.toggle(CHOICES).props(f'{TOGGLE_PROPS} aria-label="image size"').classes("vs-toggle")
        toggle.on_value_change(lambda event: fix_or_follow(event.value))
    with ui.element("div").classes("vs-row vs-fields") as fields:
        ui.label("pixels").classes("vs-label vs-narrow")
        for name in ("width", "height"):
            _extent_field(editor, name)

    def show(scene: Scene) -> None:
        toggle.set_value(image_size.follows_window)
        fields.set_visibility(not image_size.follows_window)

    editor.follow(show)


def _extent_field(editor: SceneEditor, name: str) -> None:
    field = whole_number_field(
        editor,
        name,
        lambda scene: getattr(scene.image, name),
        lambda scene, value: sized(scene, **{name: value}),
    )
    field.props(f'prefix="{name[0]}"')
