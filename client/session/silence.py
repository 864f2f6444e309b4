"""Notices servers that say nothing for too long: frozen, cut off, or on a machine that is gone.

Each is asked now and then whether it is there, which its receiving thread answers whatever else it does. Any byte that
comes counts as an answer.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from volsplat.protocol.wire.connection import Connection

SILENCE_SECONDS = 2.0  # after which a server counts as lost
LEAST_SILENCE = 0.1
AT_WORK = 15.0  # times as long while it reads or packs, when a library may hold its interpreter
LOOKS = 8  # in the time after which one counts as lost
OVERSLEPT = 2.0  # looks late: then this process was held up, and nobody else can be judged


@dataclass
class _Heard:
    connection: Connection
    nbytes: int  # that had come when it was last looked at
    since: float  # when more had come than before, time.monotonic()
    asked: bool = True  # and not answered


class SilenceWatch:
    """One thread for all servers. Any thread may call it."""

    def __init__(
        self,
        seconds: float,
        at_work: Callable[[int], bool],
        ask: Callable[[int], None],
    ) -> None:
        """`at_work` says of which servers more patience is due, `ask` has one asked whether it is there."""
        self._seconds = seconds
        self._at_work = at_work
        self._ask = ask
        self._heard: dict[int, _Heard] = {}
        self._lock = threading.Lock()  # guards _heard
        self._closed = threading.Event()
        threading.Thread(target=self._watch, name="watch for silence", daemon=True).start()

    def begin(self, server: int, connection: Connection) -> None:
        with self._lock:
            self._heard[server] = _Heard(connection, connection.counters.bytes_in, time.monotonic(), asked=False)

    def end(self, server: int) -> None:
        with self._lock:
            self._heard.pop(server, None)

    def close(self) -> None:
        self._closed.set()

    def _watch(self) -> None:
        pause, before = self._seconds / LOOKS, time.monotonic()
        while not self._closed.wait(pause):
            now = time.monotonic()
            overslept, before = now - before > OVERSLEPT * pause, now
            with self._lock:
                heard = dict(self._heard)
            for server, one in heard.items():
                if overslept:
                    one.since = now
                self._look(server, one, now)

    def _look(self, server: int, one: _Heard, now: float) -> None:
        if (nbytes := one.connection.counters.bytes_in) != one.nbytes:
            one.nbytes, one.since, one.asked = nbytes, now, False
        patience = self._seconds * (AT_WORK if self._at_work(server) else 1.0)
        if now - one.since > patience:
            self.end(server)
            one.connection.give_up(
                f"{one.connection} has said nothing for {patience:g} s: it is frozen, overloaded or cut off"
            )
        elif not one.asked:
            one.asked = True
            self._ask(server)
