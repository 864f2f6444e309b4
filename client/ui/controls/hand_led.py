"""An element of the page that shows a value, and that a person changes without seeing it jump back.

The hand leads, however slow the line: its moves are numbered, and the browser passes over what answers an earlier one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.controls.controls import show_prop


class HandLed(Element):
    """The base of elements whose component mixes in hand_led.js."""

    def __init__(self, value: Any, on_moved: Callable[[Any, bool], None]) -> None:
        """`on_moved(value, settled)` tells what a person makes of it, and whether that is the end of it for now."""
        super().__init__()
        self._moves = 0  # of the hand, that were heard of
        self.tell(value)

        def moved(event: GenericEventArguments) -> None:
            self._moves = event.args["moves"]
            on_moved(event.args["value"], bool(event.args["settled"]))

        self.on("moved", moved)

    def tell(self, value: Any) -> None:
        """Show this value, unless the hand has moved since the last move that was heard of."""
        show_prop(self, "told", {"value": value, "moves": self._moves})
