"""The wheel of phases over the viewport, for as long as the scene colours by phase."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.image.phase_wheel import DEGREES, wheel_colours
from volsplat.client.ui.controls.controls import SceneEditor
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.colours import Colour, nearest_hex
from volsplat.protocol.description.scene import Scene

_STYLE = STATIC / "controls" / "phase_legend.css"


class PhaseLegend:
    """The legend of one tab; the page hears of it only when its colours change."""

    def __init__(self, viewing: Viewing) -> None:
        ui.add_css(_STYLE)
        self._description = viewing.volume.description
        self._shown: tuple[Colour, ...] | None = None
        with ui.element("div").classes("vs-phases").props('role="img" aria-label="colours of phase"') as self._legend:
            self._wheel = ui.element("div").classes("vs-phase-wheel")
            for degrees in DEGREES:
                ui.label(degrees).classes(f"vs-phase-{degrees.removesuffix('°')}")
        self._legend.set_visibility(False)
        SceneEditor(viewing.model, self._description.geometry, "phases").follow(self._follow)

    def _follow(self, scene: Scene) -> None:
        colours = wheel_colours(self._description, scene)
        if colours == self._shown:
            return
        self._shown = colours
        self._legend.set_visibility(colours is not None)
        if colours is not None:
            self._wheel.style(f"background: {gradient(colours)}")


def gradient(colours: tuple[Colour, ...]) -> str:
    """The sectors as CSS, which turns clockwise: 0 degrees to the right, 90 at the top."""
    count = len(colours)
    sectors = ", ".join(
        f"{nearest_hex(colour)} {n / count:.5f}turn {(n + 1) / count:.5f}turn" for n, colour in enumerate(colours[::-1])
    )
    return f"conic-gradient(from 0.25turn, {sectors})"
