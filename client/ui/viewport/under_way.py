"""How many pictures may be on their way to a page: as many as its line holds, so that neither rate nor lag suffers.

A line with a long round trip needs several at once for the pictures to keep coming, a narrow one lets them queue, and
each that waits is a picture's time of lag. As in congestion control by bandwidth and delay (Cardwell et al., "BBR",
2016): what the line holds is the rate at which pictures arrive times the time that one takes by itself.
"""

from __future__ import annotations

import math
from collections import deque

LEAST = 2  # one is shown while the next comes
MOST = 16
REMEMBERED = 16  # pictures, of which the rate is taken
GAIN = 1.25  # of what the line is known to hold, to find out whether it holds more


class UnderWay:
    """Pictures that were sent and not yet shown; times are seconds of one clock that never goes back."""

    def __init__(self) -> None:
        self._sent: dict[int, float] = {}  # when, by number
        self._round_trip = math.inf  # the shortest of all: later ones may have waited behind others
        self._shown: deque[float] = deque(maxlen=REMEMBERED)  # when, without a pause between them

    def __len__(self) -> int:
        return len(self._sent)

    def may_send(self) -> bool:
        """Whether another one would find room."""
        return len(self._sent) < self.most

    @property
    def most(self) -> int:
        """One that is being taken in and as many as the line holds by what is known of it."""
        if len(self._shown) < 2 or self._shown[-1] <= self._shown[0]:
            return LEAST
        rate = (len(self._shown) - 1) / (self._shown[-1] - self._shown[0])
        return min(max(LEAST, 1 + math.floor(GAIN * rate * self._round_trip)), MOST)

    def sent(self, number: int, now: float) -> None:
        if not self._sent:  # what came before ended in a pause, which tells nothing of the line
            self._shown.clear()
        self._sent[number] = now

    def shown(self, number: int, now: float) -> None:
        """The page has this picture, or has dropped it, and so all before it."""
        if number in self._sent:
            self._round_trip = min(self._round_trip, now - self._sent[number])
            self._shown.append(now)
        self._sent = {sent: at for sent, at in self._sent.items() if sent > number}
