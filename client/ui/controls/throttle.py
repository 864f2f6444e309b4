"""Something that is done at once, but no oftener than at an interval; what was asked last is always done."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class Throttle:
    """Calls `action` within a running event loop, `interval` seconds apart or more."""

    def __init__(self, interval: float, action: Callable[[], None]) -> None:
        self._interval = interval
        self._action = action
        self._next = float("-inf")  # when it may be called again, in the loop's time
        self._waiting: asyncio.TimerHandle | None = None

    def __call__(self) -> None:
        if self._waiting is None:
            loop = asyncio.get_running_loop()
            if loop.time() >= self._next:
                self._act()
            else:
                self._waiting = loop.call_at(self._next, self._act)

    def cancel(self) -> None:
        """Do no more of what was asked until now."""
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _act(self) -> None:
        self._waiting = None
        self._next = asyncio.get_running_loop().time() + self._interval
        self._action()
