"""How many pictures a second there are while something moves, for as long as that is news."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from statistics import median

SPAN = 2.0  # seconds of movement that it is known from, and without a picture, after which another one begins
NEWS = 5.0  # seconds that it is told after the last such picture
LEAST = 4  # pictures that it is known from, none of them SPAN after the one before: a click makes fewer
PAUSE = 3.0  # times as long as is usual between two: then the hand has rested


class MovingRate:
    """Of what is noted of them; all times are of one clock, in seconds."""

    def __init__(self) -> None:
        self._times: deque[float] = deque()

    def note(self, now: float) -> None:
        """A picture of something that moves is there."""
        if self._times and now - self._times[-1] > SPAN:
            self._times.clear()
        self._times.append(now)
        while len(self._times) > LEAST and self._times[0] < now - SPAN:
            self._times.popleft()

    def left(self, now: float) -> float:
        """The seconds for which it is still news; 0 if there is nothing to tell."""
        return max(self._times[-1] + NEWS - now, 0.0) if len(self._times) >= LEAST else 0.0

    @property
    def rate(self) -> float:
        """A second, without the pauses of the hand. Only while there is something to tell."""
        between = [later - earlier for earlier, later in pairwise(self._times)]
        longest = PAUSE * median(between)
        moving = [seconds for seconds in between if seconds <= longest]
        return len(moving) / max(sum(moving), 1e-3)
