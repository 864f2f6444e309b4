"""The panels beside the picture are resized at their edges: what makes them so on the page of one tab."""

from __future__ import annotations

from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES

LEFT = {"panel": ".vs-left", "variable": "--vs-left-width", "label": "width of the scene's panel", "towards": 1}
RIGHT = {"panel": ".vs-right", "variable": "--vs-right-width", "label": "width of the tables", "towards": -1}
EDGES = ({**LEFT, "least": 22.15}, {**RIGHT, "least": 23})
"""For each panel what its width is called in page.css and to a person, which way it grows, and its least, in em."""


class PanelWidths(Element, component="panel_widths_component.js", esm=MODULES):
    """Stands after the panels."""

    def __init__(self) -> None:
        super().__init__()
        self.props["edges"] = list(EDGES)
