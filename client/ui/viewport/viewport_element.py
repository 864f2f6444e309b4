"""The viewport as an element of the page; all that it does is in static/viewport/."""

from __future__ import annotations

from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES, STATIC
from volsplat.protocol.description.view_rotation import Quaternion, named_view


class ViewportElement(Element, component="viewport_component.js", esm=MODULES):
    """Fills its parent. `home` is the rotation that reset goes to; `tab` names the tab to the process.

    `volume` is the number of the one that the page is of; `prefix` is what a proxy puts before the page's paths.
    """

    def __init__(self, tab: str, home: Quaternion, volume: int, prefix: str) -> None:
        super().__init__()
        ui.add_css(STATIC / "viewport" / "viewport.css")
        ui.add_css(STATIC / "slices" / "slices.css")
        self._props["tab"] = tab
        self._props["home"] = list(home)
        self._props["volume"] = volume
        self._props["prefix"] = prefix


def viewport_element(home: Quaternion | None = None, volume: int = 1) -> ViewportElement:
    """The viewport of the tab that is being built; reset goes to `home`, or to the front."""
    prefix: str = context.client.request.scope.get("root_path", "")
    return ViewportElement(context.client.id, home or named_view("front"), volume, prefix)
