"""The colours and opacities of the tables over the picture, in the data's units."""

from __future__ import annotations

from nicegui import events, ui

from volsplat.client.figure.colour_bars import NONE, ColourBars, colour_bars
from volsplat.client.figure.svg_file import svg_of
from volsplat.client.image.phase_wheel import wheel_colours
from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.viewing.scene_model import but_for_view
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

WIDTH = 330  # CSS pixels, until the page tells how many there are
LEAST_EM, EMS = 11, 30  # CSS pixels of the words, and how many of these the widest bar is wide
INK = (0.95, 0.95, 0.95)

_STYLE = STATIC / "controls" / "colour_bar.css"


class ColourBar:
    """The bar of one tab, drawn for the room that it has there; the page hears of it only when it changes."""

    def __init__(self, viewing: Viewing) -> None:
        ui.add_css(_STYLE)
        self._volume = viewing.volume
        self._shown, self._width = NONE, WIDTH
        self._followed: Scene | None = None  # but for its view, which moves most and has no colours
        with ui.element("div").classes("vs-colours"):
            ui.element("q-resize-observer").on("resize", self._resize, ["width"])
            bar = ui.html("", sanitize=False)
        self._bar = bar.props('role="img" aria-label="colours and opacities of the tables"')
        SceneEditor(viewing.model, viewing.volume.description.geometry, "colours").follow(self._follow)

    def _follow(self, scene: Scene) -> None:
        coloured = but_for_view(scene)
        if coloured == self._followed:
            return
        self._followed = coloured
        bars = self._bars(scene)
        if bars == self._shown:
            return
        self._shown = bars
        self._draw()

    def _resize(self, event: events.GenericEventArguments) -> None:
        width = round(event.args["width"])
        if width not in (0, self._width):  # 0: not shown
            self._width = width
            self._draw()

    def _draw(self) -> None:
        width, em = self._width, max(LEAST_EM, self._width // EMS)
        self._bar.content = svg_of(self._shown.shapes(0, width, em, INK), width, self._shown.height(width, em))

    def _bars(self, scene: Scene) -> ColourBars:
        """None if the wheel of phases tells the colours, or for a window without a scale, which its field tells of."""
        if wheel_colours(self._volume.description, scene) is not None:
            return NONE
        try:
            return colour_bars(scene, self._volume)
        except BadInput:
            return NONE
