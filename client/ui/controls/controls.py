"""What the panels' controls have in common: they show the one scene and change it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakSet

from nicegui import Client, context, ui
from nicegui.element import Element

from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.viewing.scene_model import SceneModel, SceneState
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import plan_frame

STYLE = STATIC / "controls" / "panels.css"
# Colours that Quasar does not know, so that the style sheet alone decides.
TOGGLE_PROPS = "dense no-caps unelevated toggle-color=vs toggle-text-color=vs"
MOVING_INTERVAL = 0.25  # seconds between two updates of controls while the scene is not settled
_ARROWS = """(event) => {
    const way = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!way || event.target.matches("input")) return;
    event.preventDefault();
    const items = [...event.currentTarget.querySelectorAll('.q-item[tabindex="0"]')];
    const now = items.indexOf(event.target.closest(".q-item"));
    items.at(now >= 0 ? (now + way) % items.length : way > 0 ? 0 : -1)?.focus();
}"""
_styled: WeakSet[Client] = WeakSet()

Edit = Callable[[Scene], Scene]


def panel_style() -> None:
    """Give the page the panels' style sheet, once."""
    if context.client not in _styled:
        _styled.add(context.client)
        ui.add_css(STYLE)


def title(text: str) -> None:
    """The heading of a panel, which folds and unfolds it (see folding.js)."""
    with ui.element("div").classes("vs-title").props("role=heading aria-level=2"):
        with ui.element("button").classes("vs-fold").props("type=button aria-expanded=true"):
            ui.label(text)


def show_prop(element: Element, name: str, value: Any) -> None:
    """Set a property of an element, and tell the browser only if it is another."""
    if element.props.get(name) != value:
        element.props[name] = value


def show_pressed(button: ui.button, on: bool) -> None:
    """Show that what the button does is in force."""
    button.classes(add="vs-on" if on else "", remove="" if on else "vs-on")
    show_prop(button, "aria-pressed", "true" if on else "false")


def pressable(text: str, action: Callable[[], object]) -> ui.button:
    """A framed button that can show that what it does is in force."""
    with ui.element("div").classes("vs-buttons vs-alone"):
        return ui.button(text, color=None, on_click=action).props("dense flat no-caps")


def menu_by_arrows() -> ui.menu:
    """A menu through which arrows go as well: Quasar leaves that to Tab."""
    menu = ui.menu()
    menu.on("keydown", js_handler=_ARROWS)
    return menu


def let_go_when_gone(model: SceneModel, by: str) -> None:
    """Have what the tab that is being built was at as `by` settled once it is away: the hand may be, for good."""
    client = context.client

    def disconnected() -> None:
        if not client.has_socket_connection:  # it may be connected anew before the old line's end is heard of
            model.let_go(by)

    client.on_disconnect(disconnected)
    client.on_delete(lambda: model.let_go(by))


class SceneEditor:
    """A panel's hold on the scene, within one tab."""

    def __init__(self, model: SceneModel, geometry: Geometry, panel: str) -> None:
        panel_style()
        self._model = model
        self._geometry = geometry
        self._by = f"{panel} {context.client.id}"
        self._followers: list[Callable[[Scene], object]] = []
        self._throttle = Throttle(MOVING_INTERVAL, self._show)
        let_go_when_gone(model, self._by)
        context.client.on_delete(self._throttle.cancel)
        context.client.on_delete(model.subscribe(self._on_change))

    @property
    def scene(self) -> Scene:
        return self._model.scene

    def change(self, edit: Edit, *, settled: bool = True) -> None:
        """Raises ValueError if the edit makes no scene, or none that the volume can be drawn with."""
        self._model.change(lambda scene: self.tried(edit, scene), by=self._by, settled=settled)

    def tried(self, edit: Edit, scene: Scene) -> Scene:
        """The edited scene. Raises ValueError as `change` does."""
        edited = edit(scene)
        if self._fits(scene):  # else whatever else is wrong with it would be told at this field
            plan_frame(edited, self._geometry, Step.F)
        return edited

    def _fits(self, scene: Scene) -> bool:
        try:
            plan_frame(scene, self._geometry, Step.F)
        except ValueError:
            return False
        return True

    def follow(self, show: Callable[[Scene], object]) -> None:
        """Call `show` now and after every change, whoever made it, as long as the tab is there.

        While a person is still at it (the scene is not settled) it is called now and then only: each time the whole
        page is rendered anew, which the picture would have to wait for.
        """
        self._followers.append(show)
        show(self.scene)

    def _on_change(self, state: SceneState) -> None:
        if state.settled:
            self._throttle.cancel()
            self._show()
        else:
            self._throttle()

    def _show(self) -> None:
        for show in self._followers:
            show(self.scene)


def choose(
    editor: SceneEditor,
    chooser: ui.toggle | ui.select | ui.switch,
    get: Callable[[Scene], Any],
    put: Callable[[Scene, Any], Scene],
) -> None:
    """Have a toggle, select or switch show and change the scene. `put` must take each of its values."""

    def chosen(value: Any) -> None:
        if value != get(editor.scene):
            editor.change(lambda scene: put(scene, value))

    chooser.on_value_change(lambda event: chosen(event.value))
    editor.follow(lambda scene: chooser.set_value(get(scene)))
