"""Tells map/shade servers which tiles of the image are closed, so that they leave out what lies behind.

It sends from a thread of its own: a worker that is slow to read must not hold up the splatter.
"""

import threading
from collections.abc import Sequence

from volsplat.protocol.messages.messages import TilesClosed
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection


class TileNews:
    """Only the newest map is kept: one that has not left when the next comes is forgotten."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards what follows
        self._newest: tuple[TilesClosed, bytes, Sequence[Connection]] | None = None
        self._over = False
        self._thread = threading.Thread(target=self._send, name="tell closed tiles", daemon=True)
        self._thread.start()

    def post(self, message: TilesClosed, tile_map: bytes, links: Sequence[Connection]) -> None:
        """Have a frame's map of closed tiles sent over these links."""
        with self._changed:
            self._newest = (message, tile_map, links)
            self._changed.notify()

    def close(self) -> None:
        """End the thread. The links must be closed already: that wakes a send that waits."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join()

    def _send(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest is not None or self._over)
                if self._over or self._newest is None:
                    return
                (message, tile_map, links), self._newest = self._newest, None
            for link in links:
                if not link.has_room:  # a worker that does not read must not keep the news from others
                    continue
                try:
                    link.send(message, tile_map)
                except VolsplatError:
                    continue  # who receives from it hears of the loss, and tells
