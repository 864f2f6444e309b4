"""A swatch that opens the browser's own colour picker."""

from __future__ import annotations

from collections.abc import Callable

from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.protocol.description.colours import Colour, colour_from_hex, nearest_hex
from volsplat.protocol.description.scene import Scene


class ColourSwatch(HandLed, component="colour_swatch_component.js", esm=MODULES):
    """Shows a colour of the scene, and changes it while a person picks another."""

    def __init__(
        self, editor: SceneEditor, name: str, get: Callable[[Scene], Colour], put: Callable[[Scene, Colour], Scene]
    ) -> None:
        def picked(colour: str, settled: bool) -> None:
            editor.change(lambda scene: put(scene, colour_from_hex(colour)), settled=settled)

        super().__init__(nearest_hex(get(editor.scene)), picked)
        self.props["name"] = name
        editor.follow(lambda scene: self.tell(nearest_hex(get(scene))))
