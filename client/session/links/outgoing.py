"""Sends to one server, at once or on a thread of its own: one that does not read delays no other."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import LocalProtocolError, VolsplatError
from volsplat.protocol.wire.connection import Connection, ConnectionClosed

OF_ONE_FRAME = (messages.RenderFrame, messages.AbortFrame, messages.ReadImage)


class _Posted(NamedTuple):
    message: messages.Message
    payload: tuple[memoryview, ...]


def _nothing(message: messages.Message, began: float) -> None:
    """For who need not know."""


class Outgoing:
    """Messages leave in the order in which they were posted. Any thread may post, and none waits.

    What has not left when a newer frame is posted, and is about older ones, is dropped: RenderFrame says as much.
    So no more waits than what a server is asked for besides frames, each once.
    """

    def __init__(
        self,
        connection: Connection,
        refused: Callable[[messages.Message, LocalProtocolError], None],
        lost: Callable[[Exception], None],
        sent: Callable[[messages.Message, float], None] = _nothing,
    ) -> None:
        """The sending thread calls `refused` where nothing was sent and the rest goes on, and `lost` once where nothing
        more is: by an error of the connection, or one that nobody has foreseen. `sent` is called by the thread that has
        sent it, with the moment at which that began.
        """
        self._connection = connection
        self._refused, self._lost = refused, lost
        self._sent = sent
        self._changed = threading.Condition()  # guards what follows
        self._posted: deque[_Posted] = deque()
        self._fault: Exception | None = None  # unforeseen, of what was to leave at once
        self._sending = False
        self._ended = False
        threading.Thread(target=self._send_posted, name=f"send to {connection.peer}", daemon=True).start()

    def post(self, message: messages.Message, *payload: memoryview) -> None:
        """Drop it once nothing more is sent: its server is lost, as all will hear."""
        with self._changed:
            if self._ended:
                return
            if isinstance(message, messages.RenderFrame):
                newer = [posted for posted in self._posted if not isinstance(posted.message, OF_ONE_FRAME)]
                self._posted = deque(newer)
            idle = not (self._fault or self._posted or self._sending)
            if idle and self._leaves_at_once(message, payload):
                return
            self._posted.append(_Posted(message, payload))
            self._changed.notify_all()

    def flush(self, until: float) -> None:
        """Wait until all is sent, but no longer than to a moment of time.monotonic()."""
        with self._changed:
            self._changed.wait_for(
                lambda: self._ended or not (self._posted or self._sending), max(0.0, until - time.monotonic())
            )

    def end(self) -> None:
        """Send nothing more. A send that waits is ended by closing the connection."""
        with self._changed:
            self._ended = True
            self._posted.clear()
            self._changed.notify_all()

    def _leaves_at_once(self, message: messages.Message, payload: tuple[memoryview, ...]) -> bool:
        try:
            return self._is_sent_at_once(message, payload)
        except Exception as error:  # whatever it is: the sending thread tells of it
            self._fault = error
            self._changed.notify_all()
            return True

    def _is_sent_at_once(self, message: messages.Message, payload: tuple[memoryview, ...]) -> bool:
        began = time.perf_counter()
        try:
            if any(part.nbytes for part in payload) or not self._connection.send_at_once(message):
                return False
        except VolsplatError:  # the sending thread will find the same, and reports it
            return False
        self._sent(message, began)
        return True

    def _send_posted(self) -> None:
        try:
            while (posted := self._next()) is not None:
                self._send(posted)
                del posted  # a payload's memory is used again once nobody holds it
        except ConnectionClosed:
            self.end()
        except Exception as error:  # whatever it is: nobody else sends
            self.end()
            self._lost(error)

    def _send(self, posted: _Posted) -> None:
        began = time.perf_counter()
        try:
            self._connection.send(posted.message, *posted.payload)
            self._sent(posted.message, began)
        except LocalProtocolError as error:
            self._refused(posted.message, error)

    def _next(self) -> _Posted | None:
        with self._changed:
            self._sending = False
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._ended or self._fault or self._posted)
            if self._ended:
                return None
            if self._fault is not None:
                raise self._fault
            self._sending = True
            return self._posted.popleft()
