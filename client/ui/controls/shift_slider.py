"""A slider that pushes something along an axis while it is held, and springs back when it is let go."""

from __future__ import annotations

from collections.abc import Callable

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.controls.controls import show_prop
from volsplat.client.ui.doors.static_files import MODULES


class ShiftSlider(Element, component="shift_slider_component.js", esm=MODULES):
    """`on_shift(by, settled)` tells by which share of the axis a person pushes; each push begins at 0."""

    def __init__(self, name: str, on_shift: Callable[[float, bool], None]) -> None:
        super().__init__()
        self.props["name"] = name

        def shifted(event: GenericEventArguments) -> None:
            on_shift(float(event.args["by"]), bool(event.args["settled"]))

        self.on("shift", shifted)

    def show(self, length: float, enabled: bool) -> None:
        """How long the axis is, in the data's units, and whether there is anything to push."""
        show_prop(self, "length", length)
        show_prop(self, "enabled", enabled)
