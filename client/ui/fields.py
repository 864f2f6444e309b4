"""What the panels' controls have in common: they show the one scene, change it, and tell bad input at the field."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakSet

from nicegui import Client, context, ui
from nicegui.element import Element

from volsplat.client.ui.scene_model import SceneModel, SceneState
from volsplat.client.ui.throttle import Throttle
from volsplat.protocol.frame_plan import plan_frame
from volsplat.protocol.scene import Scene, Step
from volsplat.protocol.volume import Geometry

STYLE = Path(__file__).parent / "static" / "panels.css"
# Colours that Quasar does not know, so that the style sheet alone decides.
TOGGLE_PROPS = "dense no-caps unelevated toggle-color=vs toggle-text-color=vs"
MOVING_INTERVAL = 0.25  # seconds between two updates of controls while the scene is not settled
_styled: WeakSet[Client] = WeakSet()

Edit = Callable[[Scene], Scene]


def panel_style() -> None:
    """Give the page the panels' style sheet, once."""
    if context.client not in _styled:
        _styled.add(context.client)
        ui.add_css(STYLE)


def show_prop(element: Element, name: str, value: Any) -> None:
    """Set a property of an element, and tell the browser only where it is another."""
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


class SceneEditor:
    """A panel's hold on the scene, within one tab."""

    def __init__(self, model: SceneModel, geometry: Geometry, panel: str) -> None:
        panel_style()
        self._model = model
        self._geometry = geometry
        self._by = f"{panel} {context.client.id}"
        self._followers: list[Callable[[Scene], object]] = []
        self._throttle = Throttle(MOVING_INTERVAL, self._show)
        context.client.on_delete(self._throttle.cancel)
        context.client.on_delete(model.subscribe(self._on_change))

    @property
    def scene(self) -> Scene:
        return self._model.scene

    def change(self, edit: Edit, *, settled: bool = True, undoable: bool = True) -> None:
        """Raises ValueError where the edit makes no scene, or none that the volume can be drawn with."""
        self._model.change(lambda scene: self.tried(edit, scene), by=self._by, settled=settled, undoable=undoable)

    def tried(self, edit: Edit, scene: Scene) -> Scene:
        """The edited scene. Raises ValueError as `change` does."""
        edited = edit(scene)
        if self._fits(scene):  # else whatever else is wrong with it would be told at this field
            plan_frame(edited, self._geometry, max(Step))
        return edited

    def _fits(self, scene: Scene) -> bool:
        try:
            plan_frame(scene, self._geometry, max(Step))
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


class TextField:
    """What is typed is refused while it is typed where it cannot be used, and taken at Enter or on leaving.

    `text` gives what to show; `put` makes the scene with what was typed, or raises ValueError.
    """

    def __init__(
        self,
        editor: SceneEditor,
        name: str,
        text: Callable[[Scene], str],
        put: Callable[[Scene, str], Scene],
        *,
        undoable: bool = True,
    ) -> None:
        self._editor = editor
        self._text = text
        self._put = put
        self._undoable = undoable
        self._edited = False  # what is typed is not in the scene
        self.input = (
            ui.input()
            .without_auto_validation()
            .props('dense outlined hide-bottom-space no-error-icon autocomplete="off"')
        )
        self.input.props["aria-label"] = name
        self.input.classes("vs-field")
        self.input.on_value_change(self._typed)
        self.input.on("keydown.enter", self._commit)
        self.input.on("blur", self._leave)
        editor.follow(self._show)

    def _show(self, scene: Scene) -> None:
        if not self._edited:
            self.input.set_value(self._text(scene))

    def _typed(self) -> None:
        typed = self.input.value or ""
        self._edited = typed != self._text(self._editor.scene)
        self.input.error = self._complaint(typed) if self._edited else None

    def _complaint(self, typed: str) -> str | None:
        try:
            self._editor.tried(lambda scene: self._put(scene, typed), self._editor.scene)
        except ValueError as error:
            return str(error)
        return None

    def _commit(self) -> None:
        if self._edited:
            typed = self.input.value or ""
            self.change(lambda scene: self._put(scene, typed))

    def change(self, edit: Edit) -> None:
        """Change the scene, or tell at this field why that cannot be."""
        self._edited = False  # so that the field shows what becomes of it
        try:
            self._editor.change(edit, undoable=self._undoable)
        except ValueError as error:
            self._edited = True
            self.input.error = str(error)

    def _leave(self) -> None:
        self._commit()
        self._edited = False
        self.input.error = None
        self._show(self._editor.scene)


def number_field(
    editor: SceneEditor,
    name: str,
    get: Callable[[Scene], float],
    put: Callable[[Scene, float], Scene],
    *,
    undoable: bool = True,
) -> ui.input:
    """A field for a number, see TextField."""
    field = TextField(
        editor,
        name,
        lambda scene: _short(get(scene)),
        lambda scene, typed: put(scene, _number(typed)),
        undoable=undoable,
    )
    return field.input.props("inputmode=decimal")


def whole_number_field(
    editor: SceneEditor,
    name: str,
    get: Callable[[Scene], int],
    put: Callable[[Scene, int], Scene],
    *,
    undoable: bool = True,
) -> ui.input:
    """A field for a whole number, which the arrow keys count up and down; see TextField."""
    field = TextField(
        editor,
        name,
        lambda scene: str(get(scene)),
        lambda scene, typed: put(scene, _whole_number(typed)),
        undoable=undoable,
    )
    field.input.on("keydown.up.prevent", lambda: field.change(lambda scene: put(scene, get(scene) + 1)))
    field.input.on("keydown.down.prevent", lambda: field.change(lambda scene: put(scene, get(scene) - 1)))
    return field.input.props("inputmode=numeric")


def _short(value: float) -> str:
    return f"{value:.5g}" if abs(value) < 1e5 else f"{value:.8g}"


def _number(typed: str) -> float:
    try:
        return float(typed)
    except ValueError:
        raise ValueError(f"“{typed}” is not a number" if typed.strip() else "give a number") from None


def _whole_number(typed: str) -> int:
    try:
        return int(typed)
    except ValueError:
        raise ValueError(f"“{typed}” is not a whole number" if typed.strip() else "give a whole number") from None


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
