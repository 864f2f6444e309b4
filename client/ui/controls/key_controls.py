"""The control that a scene key declares: it shows the key's value and changes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from nicegui import ui

from volsplat.client.ui.controls.colour_swatch import ColourSwatch
from volsplat.client.ui.controls.controls import TOGGLE_PROPS, SceneEditor, choose, pressable, show_pressed
from volsplat.client.ui.controls.slider import Slider
from volsplat.client.ui.controls.text_field import TextField, number_field, shown_number
from volsplat.protocol.description.colours import colour_from_hex, nearest_hex
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_key import Buttons, Menu, PartOf, Slide, Swatch, Switch
from volsplat.protocol.description.scene_keys import SceneKey
from volsplat.protocol.rules.footprint_shape import kernel_radius

# The number that a word stands for, of keys with a slider.
MEANT_NUMBERS = {"reconstruction.radius": lambda scene: kernel_radius(scene.reconstruction)}
NARROW = 7  # letters of a label that leaves more room to what stands beside it


def key_control(editor: SceneEditor, key: SceneKey, refused: Mapping[Any, str]) -> None:
    """Build it where the page is being built. Buttons of values that are `refused` are off, and tell why."""
    match key.widget:
        case Switch(label, tip):
            switch = ui.switch(label).props("dense").classes("vs-switch")
            if tip:
                switch.tooltip(tip)
            choose(editor, switch, key.of, key.put)
        case Buttons(name, labelled, tip, words):
            with ui.element("div").classes("vs-row"):
                if labelled:
                    row_label(name, tip)
                toggle = _Toggle({value: words.get(value, str(value)) for value in key.values}, refused)
                toggle.props(f'{TOGGLE_PROPS} aria-label="{name}"').classes("vs-toggle")
            choose(editor, toggle, key.of, key.put)
        case Menu(name):
            choose(editor, menu(name, {value: str(value) for value in key.values}), key.of, key.put)
        case Swatch(name):
            with ui.element("div").classes("vs-row"):
                row_label(name)
                ColourSwatch(editor, name, key.of, key.put)
                TextField(
                    editor,
                    f"{name}, #rrggbb",
                    lambda scene: nearest_hex(key.of(scene)),
                    lambda scene, text: key.put(scene, colour_from_hex(text)),
                )
        case Slide():
            _slide(editor, key, key.widget)
        case PartOf(control):
            raise AssertionError(f"{key.place} is set by the control {control!r} that is made for it")


class _Toggle(ui.toggle):
    """Its buttons of values that are `refused` are off, and tell why."""

    def __init__(self, words: dict[Any, str], refused: Mapping[Any, str]) -> None:
        self._refused = refused
        super().__init__(words)

    def _update_options(self) -> None:
        """NiceGUI makes them anew with each value that it shows."""
        super()._update_options()
        for value, option in zip(self._values, self.props["options"], strict=True):
            if value in self._refused:
                option |= {"disable": True, "attrs": {"title": self._refused[value]}}


def row_label(text: str, tip: str = "") -> None:
    """What stands before a control in its row."""
    label = ui.label(text).classes("vs-label vs-narrow" if len(text) <= NARROW else "vs-label")
    if tip:
        label.tooltip(tip)


def menu(name: str, options: dict[str, str], tip: str = "") -> ui.select:
    """A row with a menu of options, which are shown as their words."""
    with ui.element("div").classes("vs-row"):
        row_label(name, tip)
        select = ui.select(options).classes("vs-field")
        return select.props(f'dense outlined options-dense aria-label="{name}"')


def _slide(editor: SceneEditor, key: SceneKey, slide: Slide) -> None:
    assert key.told.limits is not None
    least = key.told.limits.least if slide.least is None else slide.least
    low, high = (_position(end, slide) for end in (least, key.told.limits.most))
    digits = -math.floor(math.log10(slide.step))

    def number(scene: Scene) -> float:
        value: float | str = key.of(scene)
        return MEANT_NUMBERS[key.place](scene) if isinstance(value, str) else value

    with ui.element("div").classes("vs-row"):
        row_label(slide.label, slide.tip)
        Slider(
            editor,
            [slide.label],
            (low, high),
            slide.step,
            lambda scene: round(min(high, max(low, _position(number(scene), slide))), digits),
            lambda scene, position: key.put(scene, _number_at(round(position, digits), slide)),
            lambda scene: [shown_number(number(scene))],
            logarithmic=slide.logarithmic,
            unit=key.told.unit,
        )
        number_field(editor, f"{slide.label}, a number", number, key.put).classes("vs-short")
        for word in key.declared.words:
            _word(editor, key, word)


def _word(editor: SceneEditor, key: SceneKey, word: str) -> None:
    button = pressable(word, lambda: editor.change(lambda scene: key.put(scene, word)))
    editor.follow(lambda scene: show_pressed(button, key.of(scene) == word))


def _position(number: float, slide: Slide) -> float:
    return math.log10(number) if slide.logarithmic else number


def _number_at(position: float, slide: Slide) -> float:
    return float(f"{10**position:.3g}") if slide.logarithmic else position
