"""A small ball on which a direction is dragged, shaded as a light from there would shade it.

The hand leads, as on a slider: what answers an earlier move of it is passed over.
"""

from __future__ import annotations

from collections.abc import Callable

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.fields import show_prop
from volsplat.protocol.matrices import Vector


class LightBall(Element, component="light_ball_component.js"):
    """Shows a direction along screen axes; `on_turned(direction, settled)` tells what a person makes of it."""

    def __init__(self, on_turned: Callable[[Vector, bool], None]) -> None:
        super().__init__()
        self._moves = 0  # of the hand, that were heard of
        self.show((0.0, 0.0, 1.0))

        def turned(event: GenericEventArguments) -> None:
            x, y, z = event.args["direction"]
            self._moves = event.args["moves"]
            on_turned((float(x), float(y), float(z)), bool(event.args["settled"]))

        self.on("turned", turned)

    def show(self, direction: Vector) -> None:
        """`direction` has any length but zero."""
        show_prop(self, "told", {"direction": list(direction), "moves": self._moves})
