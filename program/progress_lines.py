"""How far long work is where no terminal shows a bar: a few lines for a log, each with the time that is left."""

from __future__ import annotations

import time
from collections.abc import Callable

from volsplat.program.plain_console import PlainConsole

WORTH_A_LINE = 20.0  # seconds left
PAUSE = 60.0  # seconds between two lines, at least


class ProgressLines:
    """Of `total` parts. The time left is told by those since the last line, so that a stop is soon forgotten.

    At first by those after the first, before which there is the start.
    """

    def __init__(
        self, console: PlainConsole, total: int, words: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`clock` gives seconds."""
        self._console = console
        self._total = total
        self._words = words
        self._clock = clock
        self._since: tuple[int, float] | None = None  # parts that were done by then, and when it was
        self._silent_until = 0.0

    def describe(self, words: str) -> None:
        """What is being done from now on."""
        self._words = words

    def reach(self, done: int) -> None:
        """So many parts are."""
        now = self._clock()
        if self._since is None:
            self._since = done, now
        parts, began = self._since
        if done == parts or now < self._silent_until:
            return
        left = (now - began) / (done - parts) * (self._total - done)
        if left >= WORTH_A_LINE:
            self._silent_until = now + PAUSE
            self._since = done, now
            self._console.say(f"{self._words}: {done} of {self._total}, about {_rounded(left)} left")


def _rounded(seconds: float) -> str:
    if seconds < 90:
        return f"{10 * round(seconds / 10)} s"
    return f"{round(seconds / 60)} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
