"""Gathers what this process and the servers did for each frame, by one clock, into a trace file.

A server's clock is read when it joins and before its spans are; what it tells is asked for once the frame is over.
"""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from volsplat.client.trace.server_clocks import ServerClock
from volsplat.client.trace.trace_file import TraceFile
from volsplat.protocol.messages.handlers import handlers, takes
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.trace_messages import ClockRead, FrameTraced, ReadClock, ReadTrace, Span

ROUNDS_AT_FIRST = 8  # readings of a clock; the best of them counts
ROUNDS_LATER = 4
PATIENCE = 10.0  # seconds that a server's spans are waited for; heartbeats find lost ones sooner
FRAMES_KEPT = 4  # that are not over: newer ones end older ones
CLIENT = 0  # as the number of a process

clock = time.perf_counter


@dataclass
class _Traced:
    """A server."""

    name: str
    send: Callable[[Message], None]
    clock: ServerClock = field(default_factory=ServerClock)
    rounds: int = ROUNDS_AT_FIRST  # readings that are still to come
    asked: float = 0.0  # when the newest one was asked for
    wanted: int = 0  # frame whose spans are asked for after them
    told: FrameTraced | None = None
    error: float = 0.0  # seconds that its clock may have been off in any frame that is written
    left_out: int = 0  # spans of these

    def ask(self) -> None:
        """What comes next: a reading, or the spans of the wanted frame."""
        if self.rounds:
            self.asked = clock()
            self.send(ReadClock())
        elif self.wanted:
            self.send(ReadTrace(self.wanted))


class FrameTracer:
    """Any thread may call it."""

    def __init__(self, path: Path) -> None:
        """Raises BadInput if the file cannot be written."""
        self._file = TraceFile(path)
        self._file.name(CLIENT + 1, "client")
        self._began = clock()  # where the file's time starts
        self._servers: dict[int, _Traced] = {}
        self._changed = threading.Condition()  # guards the one above
        self._frames: dict[int, list[Span]] = {}  # this process's spans, by frame
        self._noting = threading.Lock()  # guards that; nothing else is locked within, since whoever sends notes as well
        self._gathering = threading.Lock()  # one frame after the other; guards the file

    def joined(self, server: int, name: str, send: Callable[[Message], None]) -> None:
        with self._changed:
            traced = self._servers[server] = _Traced(name, send)
            traced.ask()

    def lost(self, server: int) -> None:
        with self._changed:
            self._servers.pop(server, None)
            self._changed.notify_all()

    def take(self, server: int, message: Message, at: float) -> bool:
        """Whether a message, which came at this moment, was for the trace."""
        handler = HANDLERS.get(type(message))
        with self._changed:
            if handler is not None and (traced := self._servers.get(server)) is not None:
                handler.method(self, message, traced, at)
        return handler is not None

    @takes(ClockRead)
    def _clock_read(self, message: ClockRead, server: _Traced, at: float) -> None:
        server.clock.read(server.asked, message.clock, at)
        server.rounds -= 1
        server.ask()

    @takes(FrameTraced)
    def _frame_traced(self, message: FrameTraced, server: _Traced, at: float) -> None:
        server.told = message
        self._changed.notify_all()

    def note(self, frame: int, row: str, name: str, began: float, ended: float) -> None:
        """What this process was at for a frame, by `clock`; see FrameSpans.note."""
        with self._noting:
            self._frames.setdefault(frame, []).append(Span(row, name, began, max(began, ended)))
            while len(self._frames) > FRAMES_KEPT:
                del self._frames[min(self._frames)]

    def finish(self, frame: int) -> None:
        """Write what was done for a frame that is over. Waits for the servers' word. Raises BadInput.

        A link's thread that sent the request notes so before it sends on, so that the answer says that it has.
        """
        with self._gathering:
            with self._noting:
                own = self._frames.setdefault(frame, [])
            with self._changed:
                servers = dict(self._servers)
                for traced in servers.values():
                    idle = not traced.rounds
                    traced.wanted, traced.told = frame, None
                    traced.rounds += ROUNDS_LATER
                    if idle:
                        traced.ask()
                self._changed.wait_for(lambda: all(map(self._is_told, servers, servers.values())), PATIENCE)
            with self._noting:
                self._frames.pop(frame, None)
            self._file.add(CLIENT + 1, frame, own, -self._began)
            for server, traced in servers.items():
                self._add(server, traced, frame)

    def _is_told(self, server: int, traced: _Traced) -> bool:
        return traced.told is not None or self._servers.get(server) is not traced

    def _add(self, server: int, traced: _Traced, frame: int) -> None:
        told, reading = traced.told, traced.clock.best
        if told is None or reading is None or told.of_frame != frame:
            return
        traced.error = max(traced.error, reading.error)
        traced.left_out += told.left_out
        left_out = f", {traced.left_out} spans left out" if traced.left_out else ""
        self._file.name(server + 1, f"{traced.name}, clock ± {math.ceil(traced.error * 1e6)} µs{left_out}")
        self._file.add(server + 1, frame, told.spans, reading.offset - self._began)

    def close(self) -> None:
        """Raises BadInput if the file's end cannot be written."""
        with self._gathering:
            self._file.close()


HANDLERS = handlers(FrameTracer)
