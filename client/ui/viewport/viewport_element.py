"""The viewport as an element of the page; all that it does is in static/viewport/."""

from __future__ import annotations

from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES, STATIC
from volsplat.protocol.description.view_rotation import Quaternion


class ViewportElement(Element, component="viewport_component.js", esm=MODULES):
    """Fills its parent, in the tab that is being built."""

    def __init__(self, home: Quaternion, volume: int) -> None:
        """`home` is the rotation that reset goes to, `volume` the number of the one that the page is of."""
        super().__init__()
        ui.add_css(STATIC / "viewport" / "viewport.css")
        ui.add_css(STATIC / "slices" / "slices.css")
        self._props["tab"] = context.client.id
        self._props["home"] = list(home)
        self._props["volume"] = volume
        self._props["prefix"] = context.client.request.scope.get("root_path", "")  # what a proxy puts before paths
