"""How far walkers may be ahead of what a splat server has splatted: as far as a slow link would carry meanwhile.

Front to back, what comes first may hide what follows. A walker that runs ahead sends what the news of closed tiles
would have spared, over a link that then lacks the time for what is seen. So each has so much under way that the link is
never idle, and no more. That cannot deadlock: of all walkers that any region waits for, the one that is furthest behind
has nothing under way, since everything up to where it has come is splatted everywhere.
"""

import math
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable
from typing import NamedTuple

from volsplat.protocol.rules.packet_layout import SHADED_PACKET_BYTES

BATCHES_UNDER_WAY = 4  # of a walker, at the least: it goes on when the first of them has been splatted
LEAST_WINDOW = 16 << 10  # bytes
LEAST_PACKETS = 1 << 10  # of a batch; each has its cost
SHARE_OF_NEWEST = 0.25  # in an average
LOOK_SECONDS = 0.005  # between two looks at whether the frame is still wanted

Place = tuple[int, int]  # sheet, row
START = (0, 0)


class _UnderWay(NamedTuple):
    reached: Place
    nbytes: int


class LinkPace:
    """Of one link. Walkers send, the link's own thread hears; each frame begins anew."""

    def __init__(self, carried_meanwhile: Callable[[], float]) -> None:
        """`carried_meanwhile`: bytes that the link carries until news of what is sent comes back."""
        self._carried_meanwhile = carried_meanwhile
        self._changed = threading.Condition()  # guards what follows
        self._frame = 0
        self._window = math.inf  # bytes that each walker may have under way
        self._ended = False
        self._splatted = START
        self._under_way: defaultdict[int, deque[_UnderWay]] = defaultdict(deque)  # by walker
        self._bytes: defaultdict[int, int] = defaultdict(int)  # of these
        self._bytes_per_packet = float(SHADED_PACKET_BYTES)  # over the link

    def begin_frame(self, frame: int, walkers: int) -> None:
        """So many share the link and are held back; 0: none is."""
        carried = self._carried_meanwhile()
        with self._changed:
            self._frame, self._splatted = frame, START
            self._window = max(LEAST_WINDOW, carried / walkers) if walkers and not self._ended else math.inf
            self._under_way.clear()
            self._bytes.clear()

    @property
    def most_packets(self) -> float:
        """That the next batch should have; without end if nobody is held back."""
        return max(LEAST_PACKETS, self._window / BATCHES_UNDER_WAY / self._bytes_per_packet)

    def sent(self, walker: int, reached: Place, nbytes: int, packets: int) -> None:
        """A batch has gone that takes its walker so far."""
        with self._changed:
            if reached > self._splatted:  # news may be faster than this note
                self._under_way[walker].append(_UnderWay(reached, nbytes))
                self._bytes[walker] += nbytes
            if packets >= LEAST_PACKETS:
                self._bytes_per_packet += SHARE_OF_NEWEST * (nbytes / packets - self._bytes_per_packet)

    def splatted(self, frame: int, place: Place) -> None:
        """All that lies before this place has been splatted."""
        with self._changed:
            if frame != self._frame:
                return
            self._splatted = place
            for walker, batches in self._under_way.items():
                while batches and batches[0].reached <= place:
                    self._bytes[walker] -= batches.popleft().nbytes
            self._changed.notify_all()

    def end(self) -> None:
        """There will be no more news: whoever waits goes on, and finds in its next send what has become of the link."""
        with self._changed:
            self._ended, self._window = True, math.inf
            self._changed.notify_all()

    def wait(self, walker: int, wanted: Callable[[], bool]) -> float:
        """Until the walker may go on, or its frame is not wanted any more. How many seconds that took."""
        began = time.perf_counter()
        with self._changed:
            if self._bytes[walker] < self._window:
                return 0.0
            while self._bytes[walker] >= self._window and wanted():
                self._changed.wait(LOOK_SECONDS)
        return time.perf_counter() - began
