"""Drawers: in a small window the panels lie over the picture, and a button for each shows and hides it."""

from __future__ import annotations

from nicegui import ui
from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES, STATIC

PANELS = {"scene": ".vs-left", "tables": ".vs-right"}
"""What each button says, and which panel it shows."""


class Drawers(Element, component="drawers_component.js", esm=MODULES):
    """The buttons, which are seen only where the panels do not fit beside the picture. Stands before the panels."""

    def __init__(self) -> None:
        super().__init__()
        ui.add_css(STATIC / "controls" / "drawers.css")
        self.props["panels"] = [{"name": name, "place": place} for name, place in PANELS.items()]
