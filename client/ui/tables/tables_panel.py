"""The four shading tables on the page: each over its histogram, with what can be done to one or to all of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import msgspec
from nicegui import context, ui

from volsplat.client.ui.controls.controls import SceneEditor, let_go_when_gone, menu_by_arrows, title
from volsplat.client.ui.controls.shift_slider import ShiftSlider
from volsplat.client.ui.controls.slider import Slider
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.tables.colour_map_menu import ColourMapList
from volsplat.client.ui.tables.preset_menu import OfferedPresets, PresetMenu
from volsplat.client.ui.tables.scene_tables import IndexedFields, table_of, with_table
from volsplat.client.ui.tables.table_editor import TableEditor
from volsplat.client.ui.tables.table_edits import (
    Table,
    constant,
    inverted,
    mirrored,
    patches_with_greatest,
    ramp,
    steps,
    value_at,
    with_greatest,
)
from volsplat.client.ui.tables.table_files import table_from_toml, table_toml
from volsplat.client.ui.tables.table_shift import TableShift, by_density
from volsplat.client.ui.viewing.known_pushes import KnownPushes
from volsplat.client.ui.viewing.scene_model import SceneModel, SceneState, but_for_view
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.scene_keys import TABLE_WORDS
from volsplat.protocol.description.shading_tables import Tables

STYLE = STATIC / "tables" / "table_editor.css"
LEAST_OPACITY = 0.001  # of the slider for all opacities, whose scale is logarithmic: fog needs the small ones
STEPS = 5
_SHIFT = "shift"  # who moves all tables

replace = msgspec.structs.replace


def tables_panel(viewing: Viewing) -> None:
    """The panel, within the page of one tab."""
    TablesPanel(viewing.model, viewing.volume, viewing.default_scene, viewing.pushes)


class TablesPanel:
    """The four tables of one tab, in step with the scene."""

    def __init__(self, model: SceneModel, volume: SurveyedVolume, default_scene: Scene, pushes: KnownPushes) -> None:
        ui.add_css(STYLE)
        self._model = model
        self._tab = context.client.id
        self._volume = volume
        self._presets = OfferedPresets(volume, default_scene)
        self._table_shift = TableShift(pushes)
        self._fields = IndexedFields(volume)
        self._followed: Scene | None = None  # but for its view, which moves most and which no table shows
        with ui.element("section").classes("vs-panel vs-tables").props('aria-label="tables"'):
            self._build_head()
            self._editors = {which: self._build_table(which) for which in TABLE_WORDS}
        for what in (*TABLE_WORDS, _SHIFT):
            let_go_when_gone(model, self._by(what))
        context.client.on_delete(model.subscribe(self._follow))

    # -- building

    def _build_head(self) -> None:
        with ui.element("div").classes("vs-row vs-tables-head"):
            title("Tables")
            ui.element("div").classes("vs-spread")
            self._undo = _icon_button("undo", "undo", lambda: self._model.undo(self._by("undo")))
            self._redo = _icon_button("redo", "redo", lambda: self._model.redo(self._by("redo")))
            with (
                ui.button("Colours", icon="gradient").props("flat dense no-caps").classes("vs-quiet-button") as colours
            ):
                colours.props["title"] = "colour maps by name"
                with ui.menu().classes("vs-menu") as place:
                    maps = ColourMapList(self._take_colours)
                place.on("before-show", maps.fill)
            with ui.button("Presets", icon="palette").props("flat dense no-caps").classes("vs-quiet-button"):
                with menu_by_arrows().classes("vs-menu") as self._preset_place:
                    self._preset_menu = PresetMenu(self._presets, self._take_whole)
                self._preset_place.on("before-show", lambda: self._preset_menu.show(self._model.scene))
        with ui.element("div").classes("vs-row"):
            ui.label("All opacities").classes("vs-label")
            ui.label("log").classes("vs-muted").tooltip("the slider’s scale is logarithmic: fog needs the small ones")
            self._slider = Slider(
                SceneEditor(self._model, self._volume.description.geometry, "opacities"),
                ["greatest opacity"],
                (math.log10(LEAST_OPACITY), 0.0),
                0.01,
                lambda scene: round(math.log10(max(_greatest_opacity(scene), LEAST_OPACITY)), 2),
                _with_opacities,
                lambda scene: [_shown_opacity(scene)],
                logarithmic=True,
            )
            self._slider.tooltip("scales the opacity table, or the opacities of all patches: the greatest value")
            self._greatest = ui.label().classes("vs-number")
        with ui.element("div").classes("vs-row"):
            label = ui.label("Shift").classes("vs-label")
            called = self._volume.description.density_name
            label.tooltip(f"moves all that is indexed by {called} along it, in the data’s units")
            self._shift_slider = ShiftSlider(f"shift of all tables by {called}", self._shift)
        self._show_head()

    def _build_table(self, which: str) -> TableEditor:
        scene = self._model.scene
        editor = TableEditor(
            TABLE_WORDS[which],
            table_of(scene, which),
            self._fields.of(scene, which),
            on_change=lambda table, settled: self._change(which, lambda _: table, settled),
            on_file=lambda name, text: self._load(which, name, text),
        )
        with (
            editor,
            _icon_button("more_vert", f"{TABLE_WORDS[which]}: more"),
            menu_by_arrows().classes("vs-menu") as menu,
        ):
            edits: dict[str, Callable[[Table], Table]] = {
                "Ramp up": ramp,
                "Ramp down": partial(ramp, rising=False),
                "Constant": lambda table: constant(table, _chosen_value(table, editor.selected)),
                "Invert": inverted,
                "Mirror": mirrored,
            }
            for text, edit in edits.items():
                caption = "the selected point’s value" if text == "Constant" else ""
                _menu_item(text, partial(self._change, which, edit), caption)
            self._build_steps(which)
            ui.separator()
            with ui.menu_item("From a preset", auto_close=False):
                ui.icon("chevron_right")
                with menu_by_arrows().props('anchor="top start" self="top end"').classes("vs-menu") as presets:
                    presets.on("hide", menu.close)
            menu.on("before-show", partial(self._list_presets, which, presets))
            ui.separator()
            _menu_item("Load a file…", editor.pick_file)
            _menu_item("Save as a file", lambda: self._save(which))
        return editor

    def _list_presets(self, which: str, menu: ui.menu) -> None:
        """Once the menu around it is opened: most never are, and the page need not wait for them."""
        if menu.default_slot.children:
            return
        with menu:
            for name in self._presets.names:
                _menu_item(name, partial(self._take_table, which, name))

    def _build_steps(self, which: str) -> None:
        with ui.element("div").classes("vs-menu-row"):
            bands = ui.input(value=str(STEPS)).props("dense outlined hide-bottom-space inputmode=numeric")
            bands.classes("vs-field vs-short").props["aria-label"] = f"{TABLE_WORDS[which]}: number of steps"

            def make() -> None:
                try:
                    count = int(bands.value)
                except ValueError:
                    bands.error = "a whole number"
                    return
                try:
                    self._change(which, lambda table: steps(table, count))
                    bands.error = None
                except ValueError as error:
                    bands.error = str(error)

            bands.on("keydown.enter", make)
            ui.button("Make steps", on_click=make).props("flat dense no-caps").classes("vs-quiet-button")

    # -- what a person does

    def _change(self, which: str, edit: Callable[[Table], Table], settled: bool = True) -> None:
        self._model.change(
            lambda scene: with_table(scene, which, edit(table_of(scene, which))), by=self._by(which), settled=settled
        )

    def _shift(self, by: float, settled: bool) -> None:
        """Move the tables by density."""
        self._model.change(
            lambda scene: self._table_shift.pushed(scene, by, settled), by=self._by(_SHIFT), settled=settled
        )

    def _load(self, which: str, name: str, text: str) -> None:
        table = table_from_toml(text, self._model.scene, which, name)
        self._change(which, lambda _: table)

    def _save(self, which: str) -> None:
        ui.download.content(table_toml(self._model.scene, which), f"{which}.toml", "application/toml")

    def _take_table(self, which: str, name: str) -> None:
        """A preset's table, with the field that it is made for."""
        preset = self._presets.scene(name, self._model.scene.quantise)

        def taken(scene: Scene) -> Scene:
            cross_bar = replace(scene.cross_bar, **{which: getattr(preset.cross_bar, which)})
            return replace(with_table(scene, which, table_of(preset, which)), cross_bar=cross_bar)

        self._model.change(taken, by=self._by(which))

    def _take_colours(self, recoloured: Callable[[Tables], Tables]) -> None:
        self._model.change(lambda scene: replace(scene, tables=recoloured(scene.tables)), by=self._by("colours"))

    def _take_whole(self, name: str) -> None:
        """All that a preset sets, which is neither view, bounds nor picture."""
        if why := self._presets.why_unsuited(name):
            ui.notify(why, type="warning", close_button=True)
        preset = self._presets.scene(name, self._model.scene.quantise)
        self._model.change(
            lambda scene: replace(
                scene,
                tables=preset.tables,
                cross_bar=preset.cross_bar,
                plane=preset.plane,
                shading=preset.shading,
                light=preset.light,
            ),
            by=self._by("presets"),
        )

    def _by(self, what: str) -> str:
        return f"tables {what} {self._tab}"

    # -- following the scene

    def _follow(self, state: SceneState) -> None:
        tabled = but_for_view(state.scene)
        if tabled == self._followed and not state.settled:
            return
        self._followed = tabled
        for which, editor in self._editors.items():
            table = table_of(state.scene, which)
            # What a person drags here is on the screen already; what becomes of it is told when it is settled.
            if state.settled if state.by == self._by(which) else table != editor.table:
                editor.show_table(table)
            editor.show_field(self._fields.of(state.scene, which))
        self._show_head()
        if state.settled and self._preset_place.value:
            self._preset_menu.show(state.scene)

    def _show_head(self) -> None:
        self._undo.set_enabled(self._model.can_undo)
        self._redo.set_enabled(self._model.can_redo)
        scene = self._model.scene
        self._greatest.set_text(_shown_opacity(scene))
        self._slider.props.set_bool("disable", _greatest_opacity(scene) == 0)
        low, high = self._volume.quantisation(scene.quantise).window
        self._shift_slider.show(high - low, bool(by_density(scene)) and not scene.plane.patches)


def _greatest_opacity(scene: Scene) -> float:
    """Of the opacity table, or of any patch."""
    return max((patch.opacity for patch in scene.plane.patches), default=scene.tables.opac.greatest)


def _shown_opacity(scene: Scene) -> str:
    return f"{_greatest_opacity(scene):.3g}"


def _with_opacities(scene: Scene, logarithm: float) -> Scene:
    """All opacities scaled to a greatest of 10**logarithm, to three digits."""
    greatest = float(f"{10**logarithm:.3g}")
    if not scene.plane.patches:
        return with_table(scene, "opac", with_greatest(scene.tables.opac, greatest))
    return replace(scene, plane=replace(scene.plane, patches=patches_with_greatest(scene.plane.patches, greatest)))


def _chosen_value(table: Table, selected: int) -> tuple[float, ...]:
    """The value of the point that is selected, or else of the middle."""
    return value_at(table, table.points[selected][0] if 0 <= selected < len(table.points) else 0.5)


def _icon_button(icon: str, label: str, on_click: Callable[[], object] | None = None) -> ui.button:
    button = ui.button(icon=icon, on_click=on_click, color=None).props("flat dense round").classes("vs-icon-button")
    button.props["aria-label"] = button.props["title"] = label
    return button


def _menu_item(text: str, on_click: Callable[[], object], caption: str = "") -> None:
    with ui.menu_item(on_click=on_click), ui.item_section():
        ui.item_label(text)
        if caption:
            ui.item_label(caption).props("caption")
