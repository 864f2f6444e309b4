"""What the panels' controls have in common: they show the one scene, change it, and tell bad input where it was given."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakSet

from nicegui import Client, context, ui
from nicegui.events import GenericEventArguments

from volsplat.client.ui.scene_model import SceneModel, SceneState
from volsplat.protocol.frame_plan import plan_frame
from volsplat.protocol.scene import Scene, Step
from volsplat.protocol.volume import Geometry

STYLE = Path(__file__).parent / "static" / "panels.css"
_styled: WeakSet[Client] = WeakSet()

Edit = Callable[[Scene], Scene]
Value = TypeVar("Value")


def panel_style() -> None:
    """Give the page the panels' style sheet, once."""
    if context.client not in _styled:
        _styled.add(context.client)
        ui.add_css(STYLE)


class SceneEditor:
    """A panel's hold on the scene, within one tab."""

    def __init__(self, model: SceneModel, geometry: Geometry, panel: str) -> None:
        panel_style()
        self._model = model
        self._geometry = geometry
        self._by = f"{panel} {context.client.id}"

    @property
    def scene(self) -> Scene:
        return self._model.scene

    def change(self, edit: Edit, *, settled: bool = True, undoable: bool = True) -> None:
        """Raises ValueError where the edit makes no scene, or none that the volume can be drawn with."""
        self._model.change(lambda scene: self.tried(edit, scene), by=self._by, settled=settled, undoable=undoable)

    def tried(self, edit: Edit, scene: Scene) -> Scene:
        """The edited scene. Raises ValueError as `change` does."""
        edited = edit(scene)
        plan_frame(edited, self._geometry, max(Step))
        return edited

    def follow(self, show: Callable[[Scene], None]) -> None:
        """Call `show` now and after every change, whoever made it, as long as the tab is there."""

        def changed(state: SceneState) -> None:
            show(state.scene)

        context.client.on_delete(self._model.subscribe(changed))
        show(self.scene)


class NumberField:
    """A number in words of the scene: refused while it is typed where it cannot be used, taken at Enter or on leaving.

    `get` gives the number to show; `put` makes the scene with a number, or raises ValueError.
    """

    def __init__(
        self,
        editor: SceneEditor,
        label: str,
        get: Callable[[Scene], float],
        put: Callable[[Scene, float], Scene],
        *,
        whole: bool = False,
        undoable: bool = True,
        name: str | None = None,
    ) -> None:
        self._editor = editor
        self._get = get
        self._put = put
        self._whole = whole
        self._undoable = undoable
        self._edited = False  # what is typed is not in the scene
        self.input = ui.input(label).props('dense outlined hide-bottom-space inputmode=decimal autocomplete="off"')
        self.input.props["aria-label"] = name or label
        self.input.classes("vs-field")
        self.input.on_value_change(self._typed)
        self.input.on("keydown.enter", self._commit)
        self.input.on("blur", self._leave)
        if whole:
            self.input.on("keydown.up.prevent", lambda: self._step(1))
            self.input.on("keydown.down.prevent", lambda: self._step(-1))
        editor.follow(self._show)

    def _show(self, scene: Scene) -> None:
        if not self._edited:
            self.input.set_value(self._text(scene))

    def _text(self, scene: Scene) -> str:
        value = self._get(scene)
        return str(int(value)) if self._whole else f"{value:.6g}"

    def _edit(self, text: str) -> Edit:
        """Raises ValueError where the text is no number."""
        try:
            value = int(text) if self._whole else float(text)
        except ValueError:
            kind = "a whole number" if self._whole else "a number"
            raise ValueError(f"“{text}” is not {kind}" if text.strip() else f"give {kind}") from None
        return lambda scene: self._put(scene, value)

    def _typed(self) -> None:
        text = self.input.value or ""
        self._edited = text != self._text(self._editor.scene)
        self.input.error = self._complaint(text) if self._edited else None

    def _complaint(self, text: str) -> str | None:
        try:
            self._editor.tried(self._edit(text), self._editor.scene)
        except ValueError as error:
            return str(error)
        return None

    def _commit(self) -> None:
        if not self._edited:
            return
        try:
            edit = self._edit(self.input.value or "")
            self._edited = False  # so that the field shows what becomes of it
            self._editor.change(edit, undoable=self._undoable)
        except ValueError as error:
            self._edited = True
            self.input.error = str(error)

    def _leave(self) -> None:
        self._commit()
        self._edited = False
        self.input.error = None
        self._show(self._editor.scene)

    def _step(self, by: int) -> None:
        self._edited = False
        try:
            self._editor.change(lambda scene: self._put(scene, self._get(scene) + by), undoable=self._undoable)
        except ValueError as error:
            self.input.error = str(error)


class LiveSlider(ui.slider):
    """A slider that does not wait for the client's process: on a slow line it would jump back under the hand."""

    LOOPBACK = False


class LiveRange(ui.range):
    """See LiveSlider."""

    LOOPBACK = False


def slide(
    editor: SceneEditor,
    slider: LiveSlider | LiveRange,
    get: Callable[[Scene], Value],
    put: Callable[[Scene, Value], Scene],
) -> None:
    """Have a slider show and change the scene, which settles when the slider is let go. `put` must take any position."""

    def moved(value: Value, settled: bool) -> None:
        if settled or value != get(editor.scene):
            editor.change(lambda scene: put(scene, value), settled=settled)

    def released(event: GenericEventArguments) -> None:
        moved(event.args, True)

    slider.on_value_change(lambda event: moved(event.value, False) if event.value != get(editor.scene) else None)
    slider.on("change", released)
    editor.follow(lambda scene: slider.set_value(get(scene)))  # type: ignore[arg-type]


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
