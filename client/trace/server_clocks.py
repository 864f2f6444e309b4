"""How a server's clock stands to this process's, by asking what it shows: half the round trip is what may be off."""

from collections import deque
from typing import NamedTuple

KEPT = 8  # readings: clocks drift, so that old ones are worth less


class ClockReading(NamedTuple):
    """What is added to a server's seconds to make them this process's."""

    offset: float
    error: float  # either way


class ServerClock:
    """Of one server, by its newest readings."""

    def __init__(self) -> None:
        self._readings: deque[ClockReading] = deque(maxlen=KEPT)

    def read(self, asked: float, shown: float, heard: float) -> None:
        """It was asked and heard at these moments of this process's clock, and showed this between them."""
        self._readings.append(ClockReading((asked + heard) / 2 - shown, (heard - asked) / 2))

    @property
    def best(self) -> ClockReading | None:
        """The most certain one; None before any."""
        return min(self._readings, key=lambda reading: reading.error, default=None)
