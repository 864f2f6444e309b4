"""What the folded panel of servers says: how many there are, what a step took, and the rate while things move."""

from __future__ import annotations

import asyncio
import time

from nicegui import context
from nicegui.element import Element

from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.ui.controls.throttle import Throttle
from volsplat.client.ui.panels.servers.frame_timeline import time_text
from volsplat.client.ui.viewing.moving_rate import MovingRate
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.messages.roles import Role

INTERVAL = 0.5  # seconds between two that are told


class ServersSummary(Element, component="told_line_component.js"):
    """Of one tab."""

    def __init__(self, viewing: Viewing) -> None:
        super().__init__()
        self._viewing = viewing
        self._outcome: StepOutcome | None = None  # of the newest step that is finished
        self._rate = MovingRate()
        self._told = ""
        self._throttle = Throttle(INTERVAL, self._tell)
        self._fading: asyncio.TimerHandle | None = None  # until the rate is no news any more
        context.client.on_delete(self._end)

    def note(self, picture: Picture) -> None:
        """It is there."""
        if picture.outcome is None:
            return
        self._outcome = picture.outcome
        if not picture.state.settled:
            self._rate.note(time.monotonic())
        if picture.last or not picture.state.settled:
            self.tell()

    def tell(self) -> None:
        """Say what is known by now, soon."""
        self._throttle()

    def _tell(self) -> None:
        self._fade()
        if self._outcome is None:
            return
        left = self._rate.left(time.monotonic())
        rate = self._rate.rate if left else None
        words = summary_words(self._viewing.session.servers, self._outcome, rate)
        if words != self._told:
            self._told = words
            self.run_method("show", words)
        if left:
            self._fading = asyncio.get_running_loop().call_later(left, self.tell)

    def _fade(self) -> None:
        if self._fading is not None:
            self._fading.cancel()
            self._fading = None

    def _end(self) -> None:
        self._throttle.cancel()
        self._fade()


def summary_words(servers: list[ServerState], outcome: StepOutcome, rate: float | None = None) -> str:
    """How many servers there are, how many were lost, what the last step took, and images a second if they move."""
    counts = [
        sum(server.role is role and not server.lost for server in servers)
        for role in (Role.MAPSHADE_SERVER, Role.SPLAT_SERVER)
    ]
    lost = sum(server.lost for server in servers)
    words = [f"{counts[0]} map/shade + {counts[1]} splat", *([f"{lost} lost"] if lost else [])]
    words.append(f"step {outcome.step} in {time_text(outcome.wall_seconds)}")
    return " · ".join([*words, *([] if rate is None else [rate_text(rate)])])


def rate_text(rate: float) -> str:
    return f"{rate:.{0 if rate >= 10 else 1}f} images/s"
