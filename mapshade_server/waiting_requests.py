"""The client's requests on their way from the thread that receives them to the one that works."""

import threading
from collections import deque
from collections.abc import Callable

from volsplat.protocol.messages.exchanges import superseded
from volsplat.protocol.messages.message import Message
from volsplat.protocol.wire.framing import Received


class WaitingRequests:
    """In order, without those that a newer one has taken the place of. The exchanges say how many may wait."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards what follows
        self._waiting: deque[Received] = deque()
        self._over = False

    def put(self, received: Received) -> None:
        with self._changed:
            kept = [older for older in self._waiting if not superseded(older.message, received.message)]
            self._waiting = deque([*kept, received])
            self._changed.notify()

    def end(self) -> None:
        """Nothing more comes."""
        with self._changed:
            self._over = True
            self._changed.notify()

    def wake(self) -> None:
        """Something may have ended that `get_during` is told of."""
        with self._changed:
            self._changed.notify()

    def get_during(self, suits: Callable[[Message], bool], ended: Callable[[], bool]) -> Received | None:
        """The first request that suits, before its turn, once there is one; None once something else has ended."""

        def suiting() -> Received | None:
            return next((request for request in self._waiting if suits(request.message)), None)

        with self._changed:
            self._changed.wait_for(lambda: ended() or suiting())
            request = None if ended() else suiting()
            if request is not None:
                self._waiting.remove(request)
            return request

    def get(self) -> Received | None:
        """The next request, once there is one; None once nothing more comes: nobody waits for what is left."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._over)
            return None if self._over else self._waiting.popleft()
