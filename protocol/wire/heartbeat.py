"""Signs of life: has each connection say `Alive` where nothing else is said, and gives up peers that are silent.

A thread of its own does both, so that neither a peer that does not read nor a frame that is worked at delays it, and it
never waits in a send. Where a library may hold the interpreter, signs are left with something outside of it (see
signs_of_life), so that only a process that is stopped is silent. A peer has said something if any byte has come, even
one that is still to be read: what is late on this side is not held against the peer. Only time that this thread was
awake counts, by small steps: whoever was stopped, or slept, or had no core, blames nobody for it.

A peer may be heard, and yet nothing of full size get through to it (MTU): so it is given up as well where the system
sends the same again and again. One that only does not read takes nothing either, but loses nothing.
"""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from volsplat.protocol.messages.session_messages import LEAST_SILENCE
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.signs_of_life import GiveSigns, LeaveSigns, SignsOfLife

SILENCE_SECONDS = 2.0  # after which a peer counts as lost
HELD = 15.0  # times as long a library may hold an interpreter: that of a server at work, and any client's
UNTAKEN = 5.0  # times as long the network may swallow what is sent, and an end that always reads may leave it
SIGNS_IN_SILENCE = 4  # in the time after which a peer would give this end up
SIGNS_LEFT = int(HELD * SIGNS_IN_SILENCE)
LONGEST_STEP = LEAST_SILENCE / 2  # so that who has the least patience hears of it in time
STEPS = 2 * SIGNS_IN_SILENCE  # in the time after which a peer counts as lost
MOST_OF_A_STEP = 2.0  # times a step that count, if this thread came later

Patience = Callable[[], float]  # seconds of silence; it may change from one moment to the next


@dataclass
class _Pulse:
    """What has gone over one connection, as it was last looked at."""

    connection: Connection
    patience: Patience | None
    heard: int = field(init=False)
    said: int = -1  # other than any count: it is told of life at once
    silent: float = 0.0  # part of the patience that is used up
    quiet: float = 0.0  # seconds since this side has said anything
    taken: int = 0  # bytes of what was said
    swallowed: float = 0.0  # seconds in which the same was sent again, and no more was taken

    def __post_init__(self) -> None:
        self.heard = self.connection.came

    def beat(self, seconds: float, own_silence: float) -> None:
        """So much time has passed."""
        if self.connection.signs_left <= SIGNS_LEFT // 2:  # what is said makes more ready
            self._speak(seconds, own_silence)
        patience = self.patience() if self.patience is not None else None
        if patience is not None:
            self._listen(seconds, patience)
        self._follow_delivery(seconds, max(UNTAKEN * own_silence, patience or 0.0))

    def _speak(self, seconds: float, own_silence: float) -> None:
        new, self.said = self.said < 0, max(self.said, 0)
        if self.connection.counters.bytes_out != self.said:
            self.said, self.quiet = self.connection.counters.bytes_out, 0.0
        self.quiet += seconds
        if new or self.quiet >= STEPS / SIGNS_IN_SILENCE * step(self.connection.peers_silence or own_silence):
            self.connection.say_alive(own_silence)

    def _listen(self, seconds: float, patience: float) -> None:
        if (heard := self.connection.came) != self.heard or self.connection.unread:
            self.heard, self.silent = heard, 0.0
            return
        self.silent += seconds / patience
        if self.silent >= 1.0:
            self.connection.give_up(
                f"{self.connection} has said nothing for {patience:g} s: it is frozen, overloaded or cut off"
            )

    def _follow_delivery(self, seconds: float, limit: float) -> None:
        sends_again, taken = self.connection.delivery
        self.swallowed = self.swallowed + seconds if sends_again and taken == self.taken else 0.0
        self.taken = taken
        if self.swallowed >= limit:
            self.connection.give_up_sending()


def step(silence: float) -> float:
    """Seconds between two looks."""
    return min(silence / STEPS, LONGEST_STEP)


def patience_with_client(client: Connection, silence: float) -> Patience | None:
    """A server's. None where the system would tell of its end: one that a person has stopped may go on."""
    return None if client.may_share_memory else lambda: HELD * silence


class Heartbeat:
    """One thread for all connections of a process. Any thread may call it."""

    def __init__(self, silence: float = SILENCE_SECONDS, give_signs: GiveSigns | None = None) -> None:
        """`silence` is what the other ends are told: seconds after which they are lost.

        `give_signs` is for at_work().
        """
        self.silence = silence
        self._give_signs = give_signs
        self._pulses: list[_Pulse] = []
        self._lock = threading.Lock()  # guards _pulses
        self._work_lock = threading.Lock()  # guards what follows, and that it is said in order
        self._at_work = Counter[Connection]()  # threads
        self._closed = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    def keep(self, connection: Connection, patience: Patience | None) -> None:
        """Keep an open connection alive until it is closed, as once its peer is silent; None: that need not speak."""
        with self._lock:
            self._pulses.append(_Pulse(connection, patience))

    def close(self) -> None:
        self._closed.set()

    @contextmanager
    def at_work(self, connection: Connection) -> Iterator[None]:
        """What is done within may hold the interpreter for `HELD` silences. Raises what sending raises.

        Several threads may be at it at a time.
        """
        with self._work_lock:
            if not self._at_work[connection]:
                connection.leave_signs(self.silence, self._leave(connection))
            self._at_work[connection] += 1
        try:
            yield
        finally:
            with self._work_lock:
                self._at_work[connection] -= 1
                if not self._at_work[connection]:
                    connection.leave_no_signs()

    def _leave(self, connection: Connection) -> LeaveSigns:
        """Leaves signs with something outside of the interpreter, as often as the peer asks for them."""
        give = self._give_signs
        assert give is not None, "a heartbeat that nobody is at work beside"

        def leave(socket: int, ready: Callable[[], bytes]) -> SignsOfLife | None:
            seconds = (connection.peers_silence or LEAST_SILENCE) / SIGNS_IN_SILENCE
            with suppress(RuntimeError):  # for want of a thread: the interpreter's own words must do
                return give(socket, [ready() for _ in range(SIGNS_LEFT)], seconds)
            return None

        return leave

    def _beat(self) -> None:
        before = time.monotonic()
        while not self._closed.wait(self._step()):
            now = time.monotonic()
            seconds, before = min(now - before, MOST_OF_A_STEP * self._step()), now
            with self._lock:
                self._pulses = [pulse for pulse in self._pulses if not pulse.connection.closed]
                pulses = list(self._pulses)
            for pulse in pulses:
                pulse.beat(seconds, self.silence)

    def _step(self) -> float:
        with self._lock:
            limits = [pulse.connection.peers_silence for pulse in self._pulses]
        return min(step(limit) for limit in (self.silence, *limits) if limit)
