"""Fields that text or numbers are typed into."""

from __future__ import annotations

from collections.abc import Callable

from volsplat.client.ui.controls.controls import Edit, SceneEditor, show_prop
from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.protocol.description.scene import Scene


class TextField(HandLed, component="text_field_component.js", esm=MODULES):
    """What is typed is refused while it is typed if it cannot be used, and taken at Enter or on leaving.

    `get` gives what to show; `put` makes the scene with what was typed, or raises ValueError.
    """

    def __init__(
        self,
        editor: SceneEditor,
        name: str,
        get: Callable[[Scene], str],
        put: Callable[[Scene, str], Scene],
    ) -> None:
        super().__init__(get(editor.scene), self._on_typed)
        self._editor = editor
        self._get = get
        self._put = put
        self._typed: str | None = None  # if that is not in the scene
        self.props["name"] = name
        self.classes("vs-field")
        self.on("keydown.enter", self._commit)
        self.on("blur", self._leave)
        editor.follow(self._show)

    def _show(self, scene: Scene) -> None:
        if self._typed is None:
            self._complain("")
            self.tell(self._get(scene))

    def _complain(self, complaint: str) -> None:
        show_prop(self, "complaint", complaint)

    def _on_typed(self, text: str | None, _settled: bool) -> None:
        text = text or ""
        known = text == self._get(self._editor.scene)
        self._typed = None if known else text
        self._complain("" if known else self._fault_of(text))

    def _fault_of(self, text: str) -> str:
        try:
            self._editor.tried(lambda scene: self._put(scene, text), self._editor.scene)
        except ValueError as error:
            return str(error)
        return ""

    def _commit(self) -> None:
        text = self._typed
        if text is not None:
            self.change(lambda scene: self._put(scene, text))

    def change(self, edit: Edit) -> None:
        """Change the scene, or tell at this field why that cannot be."""
        typed, self._typed = self._typed, None  # so that the field shows what becomes of it
        try:
            self._editor.change(edit)
        except ValueError as error:
            self._typed = typed
            self._complain(str(error))

    def _leave(self) -> None:
        self._commit()
        self._typed = None
        self._show(self._editor.scene)


def number_field(
    editor: SceneEditor,
    name: str,
    get: Callable[[Scene], float],
    put: Callable[[Scene, float], Scene],
) -> TextField:
    """A field for a number, see TextField."""
    field = TextField(
        editor,
        name,
        lambda scene: shown_number(get(scene)),
        lambda scene, typed: put(scene, _number(typed)),
    )
    return field.props("inputmode=decimal")


def whole_number_field(
    editor: SceneEditor,
    name: str,
    get: Callable[[Scene], int],
    put: Callable[[Scene, int], Scene],
) -> TextField:
    """A field for a whole number, which the arrow keys count up and down; see TextField."""
    field = TextField(
        editor,
        name,
        lambda scene: str(get(scene)),
        lambda scene, typed: put(scene, _whole_number(typed)),
    )
    field.on("keydown.up.prevent", lambda: field.change(lambda scene: put(scene, get(scene) + 1)))
    field.on("keydown.down.prevent", lambda: field.change(lambda scene: put(scene, get(scene) - 1)))
    return field.props("inputmode=numeric")


def shown_number(value: float) -> str:
    """To what a float32 holds, as most volumes do: one that was typed is still seen as it was typed."""
    return f"{value:.7g}" if abs(value) < 1e5 else f"{value:.8g}"


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
