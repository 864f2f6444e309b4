"""A small ball on which a direction is dragged, shaded as a light from there would shade it."""

from __future__ import annotations

from collections.abc import Callable

from volsplat.client.ui.controls.hand_led import HandLed
from volsplat.client.ui.doors.static_files import MODULES
from volsplat.protocol.geometry.matrices import Vector


class LightBall(HandLed, component="light_ball_component.js", esm=MODULES):
    """Shows a direction along screen axes; `on_turned(direction, settled)` tells what a person makes of it."""

    def __init__(self, on_turned: Callable[[Vector, bool], None]) -> None:
        def turned(direction: list[float], settled: bool) -> None:
            x, y, z = direction
            on_turned((float(x), float(y), float(z)), settled)

        super().__init__([0.0, 0.0, 1.0], turned)

    def show(self, direction: Vector) -> None:
        """`direction` has any length but zero."""
        self.tell(list(direction))
