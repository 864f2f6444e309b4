"""Panels are folded by their headings: what makes them so on the page of one tab."""

from __future__ import annotations

from nicegui.element import Element

from volsplat.client.ui.doors.static_files import MODULES


class Folding(Element, component="folding_component.js", esm=MODULES):
    """Stands after the panels."""
