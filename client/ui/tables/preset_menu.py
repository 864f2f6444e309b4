"""The presets on the page: what they make of the volume, and the menu that offers them, each with its colours."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

from nicegui import ui

from volsplat.client.scene.presets import PRESETS, fits
from volsplat.client.scene.suited import why_unsuited
from volsplat.client.ui.controls.controls import show_prop
from volsplat.client.ui.tables.table_edits import value_at
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.shading_tables import ColourTable, Field

FROM_DATA = "from the data"
SAMPLES = 32  # of a strip of colours


class OfferedPresets:
    """The presets, and what the data itself suggests, as scenes of one volume."""

    def __init__(self, volume: SurveyedVolume, default_scene: Scene) -> None:
        self._volume = volume
        self._default_scene = default_scene
        self._scenes = lru_cache(maxsize=4 * len(PRESETS))(volume.begun_scene)
        subject = volume.subject()
        fitting = [name for name in PRESETS if fits(name, subject)]
        self.groups = [[FROM_DATA, *fitting], [name for name in PRESETS if name not in fitting]]
        """The names; first of what suits the data, as far as that is known."""

    @property
    def names(self) -> list[str]:
        return [name for group in self.groups for name in group]

    def description(self, name: str) -> str:
        """One line."""
        return "what the volume is first seen with" if name == FROM_DATA else PRESETS[name].description

    def why_unsuited(self, name: str) -> str | None:
        """A line for a person if it does not suit the volume."""
        return None if name == FROM_DATA else why_unsuited(name, self._volume.subject())

    def scene(self, name: str, quantise: Quantise) -> Scene:
        """What it is under the scene's window of densities. Raises BadInput for one without a scale."""
        if name == FROM_DATA and quantise == self._default_scene.quantise:
            return self._default_scene
        return self._scenes(None if name == FROM_DATA else name, quantise)


class PresetMenu:
    """A menu's items, within the menu that is being built. `take(name)` is called for the one that is chosen."""

    def __init__(self, offered: OfferedPresets, take: Callable[[str], None]) -> None:
        self._offered = offered
        self._items: dict[str, ui.menu_item] = {}
        self._strips: dict[str, ui.element] = {}
        for group in offered.groups:
            if self._items:
                ui.separator()
            for name in group:
                self._build(name, partial(take, name))

    def _build(self, name: str, on_click: Callable[[], None]) -> None:
        with ui.menu_item(on_click=on_click).classes("vs-preset") as self._items[name]:
            self._strips[name] = ui.element("div").classes("vs-preset-strip")
            with ui.item_section():
                ui.item_label(name)
                ui.item_label(self._offered.description(name)).props("caption")

    def show(self, scene: Scene) -> None:
        """Show what the presets are for this scene's window, and which of them is in force."""
        for name, item in self._items.items():
            preset = self._offered.scene(name, scene.quantise)
            show_prop(item, "aria-current", "true" if in_force(preset, scene) else "false")
            self._strips[name].style(strip(preset))


def in_force(preset: Scene, scene: Scene) -> bool:
    """Whether the scene's samples look as the preset has them, wherever the light stands."""
    return _look(preset) == _look(scene)


def _look(scene: Scene) -> tuple[object, ...]:
    return scene.tables, scene.cross_bar, scene.plane, scene.shading


def strip(preset: Scene) -> str:
    """The colours of what the preset lights, as a CSS background; they fade with an opacity by the same field."""
    lit, field = _lit(preset)
    opacity = preset.tables.opac
    greatest = opacity.greatest if field is preset.cross_bar.opac else 0.0
    stops = []
    for n in range(SAMPLES):
        position = n / (SAMPLES - 1)
        channels = zip(*(value_at(table, position) for table in lit), strict=True)
        colour = " ".join(f"{255 * min(sum(parts), 1.0):.0f}" for parts in channels)
        (now,) = value_at(opacity, position)
        stops.append(f"rgb({colour} / {now / greatest if greatest else 1.0:.2f})")
    return f"background-image: linear-gradient(90deg, {', '.join(stops)})"


def _lit(preset: Scene) -> tuple[list[ColourTable], Field]:
    """The tables whose light adds up, reflected and emitted by the same field, or else the first of them."""
    shading, tables, cross_bar = preset.shading, preset.tables, preset.cross_bar
    lights = [(tables.refl, cross_bar.refl)] if shading.diffuse or shading.specular else []
    lights += [(tables.emit, cross_bar.emit)] if shading.emitted or not lights else []
    field = lights[0][1]
    return [table for table, by in lights if by is field], field
