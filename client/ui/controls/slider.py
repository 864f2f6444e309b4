"""A slider that does not jump back under the hand that moves it, however slow the line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.protocol.description.scene import Scene


class Slider(HandLed, component="slider_component.js", esm=MODULES):
    """A slider for a number, or a range for {"min", "max"}; what it changes settles when it is let go.

    `get` gives its position in a scene; `put` makes a scene of it, and must take any position.
    """

    def __init__(
        self,
        editor: SceneEditor,
        name: str,
        span: tuple[float, float],
        step: float,
        get: Callable[[Scene], Any],
        put: Callable[[Scene, Any], Scene],
        tag: Literal["q-slider", "q-range"] = "q-slider",
    ) -> None:
        super().__init__(get(editor.scene), self._slid)
        self.props.update({"tag": tag, "name": name, "min": span[0], "max": span[1], "step": step})
        self._editor = editor
        self._get = get
        self._put = put
        self._held = False
        editor.follow(self._show)

    def _slid(self, position: Any, settled: bool) -> None:
        self._held = not settled
        self._editor.change(
            lambda scene: self._put(scene, position) if position != self._get(scene) else scene, settled=settled
        )
        self._show(self._editor.scene)

    def _show(self, scene: Scene) -> None:
        if not self._held:
            self.tell(self._get(scene))
