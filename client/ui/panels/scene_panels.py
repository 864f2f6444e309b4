"""The panels of the scene's keys: a control for each, as the key declares it, in the order of the scene."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, NamedTuple

from nicegui import ui

from volsplat.client.ui.controls.controls import SceneEditor, title
from volsplat.client.ui.controls.density_window_fields import density_window_fields
from volsplat.client.ui.controls.image_size_fields import image_size_fields
from volsplat.client.ui.controls.key_controls import key_control
from volsplat.client.ui.controls.patches_control import patches_control
from volsplat.client.ui.panels.bounds_controls import bounds_controls
from volsplat.client.ui.panels.cross_bar import cross_bar
from volsplat.client.ui.panels.light_controls import light_controls
from volsplat.client.ui.panels.view_controls import center_fields, move_buttons, side_buttons, up_menu
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene_key import PartOf, Switch
from volsplat.protocol.description.scene_keys import KEYS, SceneKey
from volsplat.protocol.rules.refinement import FINEST


class ScenePanel(NamedTuple):
    name: str
    title: str  # "" if a control brings its own
    sections: tuple[str, ...]  # of the scene's keys, or single keys, which then stand nowhere else


PANELS = (
    ScenePanel("window", "Window", ("quantise.window",)),
    ScenePanel("shading", "Shading", ("cross_bar", "shading", "light")),
    ScenePanel("2-D table", "2-D table", ("plane",)),
    ScenePanel("view", "View", ("view",)),
    ScenePanel("bounds", "", ("bounds",)),
    ScenePanel("refinement", "How the image forms", ("", "refine", "reconstruction")),
    ScenePanel("image", "Image", ("quantise", "image")),
)
CONTROLS: dict[str, Callable[[SceneEditor, Viewing], None]] = {
    "bounds": bounds_controls,
    "centre": center_fields,
    "cross-bar": cross_bar,
    "density window": density_window_fields,
    "light": light_controls,
    "moves": move_buttons,
    "sides": side_buttons,
    "patches": patches_control,
    "size": image_size_fields,
    "up": up_menu,
}
"""The controls that are made for a key, or for several; the tables have a panel of their own."""


def scene_panels(viewing: Viewing) -> None:
    """All but the tables."""
    for panel in PANELS:
        editor = SceneEditor(viewing.model, viewing.volume.description.geometry, panel.name)
        with ui.element("section").classes("vs-panel").props(f'aria-label="{panel.name}"'):
            if panel.title:
                title(panel.title)
            for section in panel.sections:
                _section(editor, viewing, section)


def _section(editor: SceneEditor, viewing: Viewing, section: str) -> None:
    """Switches share a row, as do keys their control; the first of them has its place."""
    groups: dict[str, list[SceneKey]] = {}
    for key in KEYS.values():
        if section == place_of(key) and _has_effect(key, viewing):
            groups.setdefault(_group_of(key), []).append(key)
    for name, keys in groups.items():
        if name in CONTROLS:
            CONTROLS[name](editor, viewing)
        else:
            with ui.element("div").classes("vs-switches") if len(keys) > 1 else nullcontext():
                for key in keys:
                    key_control(editor, key, _refused(key, viewing))


def place_of(key: SceneKey) -> str:
    """What a panel names to have it: the key itself if one does, else its section."""
    alone = any(key.place in panel.sections for panel in PANELS)
    return key.place if alone else key.section


def _group_of(key: SceneKey) -> str:
    match key.widget:
        case PartOf(control):
            return control
        case Switch():
            return "switches"
    return key.place


def _has_effect(key: SceneKey, viewing: Viewing) -> bool:
    """Whether the volume has what the key is about. Why it has no slabs stands at the button of step G."""
    prepared = viewing.volume.prepared
    if key.told.slabs_alone:
        return viewing.volume.has(Step.G)
    return key.place != "refine.striding" or (prepared is not None and len(prepared.levels) > 1)


def _refused(key: SceneKey, viewing: Viewing) -> dict[Any, str]:
    """The values of which the volume has no picture, and why."""
    if key.place != FINEST:
        return {}
    whys = {step: viewing.volume.why_without(step) for step in Step}
    return {step: why for step, why in whys.items() if why}
