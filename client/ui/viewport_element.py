"""The viewport as an element of the page; all that it does is in static/viewport.js."""

from __future__ import annotations

from pathlib import Path

from nicegui import context, ui
from nicegui.element import Element

from volsplat.client.view_rotation import Quaternion, named_view

_STATIC = Path(__file__).parent / "static"


class ViewportElement(Element, component="viewport_component.js", esm={"volsplat": "static"}):
    """Fills its parent. `home` is the rotation that reset goes to; `tab` names the tab to the process."""

    def __init__(self, tab: str, home: Quaternion) -> None:
        super().__init__()
        ui.add_css(_STATIC / "viewport.css")
        self._props["tab"] = tab
        self._props["home"] = list(home)

    def look_from(self, side: str) -> None:
        """Turn to one of the six sides: front, back, left, right, top or bottom."""
        self.run_method("lookFrom", side)

    def reset(self) -> None:
        self.run_method("reset")

    def fit(self) -> None:
        """Bring the whole volume into the picture."""
        self.run_method("fit")

    def roll(self, degrees: float) -> None:
        """Turn the picture counter-clockwise."""
        self.run_method("rollBy", degrees)

    def set_inertia(self, on: bool) -> None:
        """Whether the volume goes on turning when it is let go."""
        self.run_method("setInertia", on)


def viewport_element(home: Quaternion | None = None) -> ViewportElement:
    """The viewport of the tab that is being built."""
    return ViewportElement(context.client.id, home or named_view("front"))
