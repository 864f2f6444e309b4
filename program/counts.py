"""What a process has done since it started, as numbers that only rise: for whoever watches it."""

import threading
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple


class Counted(NamedTuple):
    what: str  # for a person
    label: str = ""  # what tells the numbers apart, if there are several


COUNTED = {
    "frames": Counted("Frames by how they ended: finished, incomplete or given up", "outcome"),
    "frame_seconds": Counted("Seconds that finished frames took, by stage", "stage"),
    "packets": Counted("Shaded packets of finished frames"),
    "batches": Counted("Batches of finished frames"),
    "link_bytes": Counted("Bytes of batches and images that went over a link", "link"),
    "link_waiting_seconds": Counted("Seconds that sending waited for the receiver or the network", "link"),
    "link_held_back_seconds": Counted("Seconds that a link was not read because its buffers were full", "link"),
    "losses": Counted("Servers or links that were lost", "of"),
}

Key = tuple[str, str]  # what is counted, and its label's value


class Counts:
    """Any thread may add."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sums: defaultdict[Key, float] = defaultdict(float)

    def add(self, what: str, amount: float = 1.0, of: str = "") -> None:
        """`what` is one of COUNTED, `of` the value of its label."""
        assert bool(of) == bool(COUNTED[what].label), what
        with self._lock:
            self._sums[what, of] += amount

    def add_all(self, what: str, amounts: Iterable[tuple[str, float]]) -> None:
        """Several at once, each with the value of its label."""
        for of, amount in amounts:
            self.add(what, amount, of)

    def sums(self) -> dict[Key, float]:
        with self._lock:
            return dict(self._sums)
