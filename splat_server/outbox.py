"""Sends to the client from a thread of its own, so that the work goes on while a large image is on its way."""

import queue
import threading
from collections.abc import Callable

from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection, ConnectionClosed


class Outbox:
    """Messages leave in the order in which they were posted.

    One thread posts. It posts an image only while `holds_image` is False, so that no more than one waits in memory.
    """

    def __init__(
        self, client: Connection, image_sent: Callable[[], None], failed: Callable[[VolsplatError], None]
    ) -> None:
        """`image_sent` and `failed` are called by the sending thread; after `failed` nothing more is sent."""
        self.holds_image = False
        self._client = client
        self._image_sent = image_sent
        self._failed = failed
        self._posted: queue.SimpleQueue[tuple[messages.Message, bytes | memoryview] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._send_posted, name="send to client", daemon=True)
        self._thread.start()

    def post(self, message: messages.Message) -> None:
        self._posted.put((message, b""))

    def post_image(self, message: messages.ImageRead, pixels: bytes | memoryview) -> None:
        self.holds_image = True
        self._posted.put((message, pixels))

    def close(self) -> None:
        """End the thread. The client's connection must be closed already: it wakes a send that waits."""
        self._posted.put(None)
        self._thread.join()

    def _send_posted(self) -> None:
        while (posted := self._posted.get()) is not None:
            message, pixels = posted
            del posted
            try:
                self._client.send(message, pixels)
            except ConnectionClosed:
                return
            except VolsplatError as error:
                self._failed(error)
                return
            if isinstance(message, messages.ImageRead):
                del pixels
                self.holds_image = False
                self._image_sent()
