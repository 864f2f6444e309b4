"""The window of densities on the page: typed, or one of those that the data suggests."""

from __future__ import annotations

from typing import Literal

from nicegui import ui

from volsplat.client.histogram.density_histogram import window_of_shares
from volsplat.client.ui.controls.controls import SceneEditor, show_pressed
from volsplat.client.ui.controls.text_field import number_field
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import KEYS

Window = tuple[float, float]

WINDOW = KEYS["quantise.window"]


def density_window_fields(editor: SceneEditor, viewing: Viewing) -> None:
    """Both ends, and buttons for the windows that hold all or most of the voxels."""
    volume = viewing.volume
    called = volume.description.density_name
    with ui.element("div").classes("vs-row vs-fields"):
        label = ui.label(called).classes("vs-label vs-of-volume")
        label.tooltip(f"the window of {called}, in the data's units, that becomes the 256 entries of a table")
        for side, end in enumerate(("lowest", "highest")):
            _end_field(editor, volume.automatic_window, side, f"{end} {called}")
    with ui.element("div").classes("vs-buttons"):
        _button(editor, "automatic", "auto", "chosen from the data")
        for text, share, meaning in (
            ("all", 0.0, "all that occurs"),
            ("1–99 %", 0.01, "without the lowest and the highest hundredth of the voxels"),
            ("5–95 %", 0.05, "without the lowest and the highest twentieth of the voxels"),
        ):
            window = _window_without(share, volume)
            _button(editor, text, window, meaning).set_enabled(window[0] < window[1])


def _window_without(share: float, volume: SurveyedVolume) -> Window:
    """All densities but for this share of the voxels on either side."""
    if not share:
        return (volume.survey.low, volume.survey.high)
    return window_of_shares(volume.survey, volume.density_counts, share, 1.0 - share)


def _button(editor: SceneEditor, text: str, window: Window | Literal["auto"], meaning: str) -> ui.button:
    button = ui.button(text, color=None, on_click=lambda: editor.change(lambda scene: WINDOW.put(scene, window)))
    button.props("dense flat no-caps").tooltip(meaning)
    editor.follow(lambda scene: show_pressed(button, WINDOW.of(scene) == window))
    return button


def _end_field(editor: SceneEditor, automatic: Window, side: int, name: str) -> None:
    def window(scene: Scene) -> Window:
        return automatic if scene.quantise.window == "auto" else scene.quantise.window

    def put(scene: Scene, value: float) -> Scene:
        low, high = window(scene)
        return WINDOW.put(scene, (value, high) if side == 0 else (low, value))

    number_field(editor, name, lambda scene: window(scene)[side], put)
