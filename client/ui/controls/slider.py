"""A slider that does not jump back under the hand that moves it, however slow the line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.protocol.description.scene import Scene


class Slider(HandLed, component="slider_component.js", esm=MODULES):
    """A slider for a number, or with two names a range for {"min", "max"}; what it changes settles when it is let go.

    `get` gives its position in a scene; `put` makes a scene of it, and must take any position. `shown` gives what the
    page shows beside it, a number for each name, in the unit: that is what screen readers are told. On a logarithmic
    scale a position is the logarithm of such a number to the base 10.
    """

    def __init__(
        self,
        editor: SceneEditor,
        names: Sequence[str],
        span: tuple[float, float],
        step: float,
        get: Callable[[Scene], Any],
        put: Callable[[Scene, Any], Scene],
        shown: Callable[[Scene], Sequence[str]],
        *,
        logarithmic: bool = False,
        unit: str = "",
    ) -> None:
        self._editor = editor
        self._get = get
        self._put = put
        self._shown = shown
        self._held = False
        super().__init__(self._told(editor.scene), self._slid)
        self.props.update({"names": list(names), "min": span[0], "max": span[1], "step": step})
        self.props.update({"logarithmic": logarithmic, "unit": unit})
        editor.follow(self._show)

    def _slid(self, position: Any, settled: bool) -> None:
        self._held = not settled
        self._editor.change(
            lambda scene: self._put(scene, position) if position != self._get(scene) else scene, settled=settled
        )
        self._show(self._editor.scene)

    def _show(self, scene: Scene) -> None:
        if not self._held:
            self.tell(self._told(scene))

    def _told(self, scene: Scene) -> dict[str, Any]:
        return {"position": self._get(scene), "texts": list(self._shown(scene))}
