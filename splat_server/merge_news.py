"""Tells map/shade servers how far the merge is and which tiles are closed, so that they leave out what lies behind.

It sends from a thread of its own: a worker that is slow to read must not hold up the splatter.
"""

import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from volsplat.protocol.messages.messages import MergeReached, TilesClosed
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection

RETRY_SECONDS = 0.02  # of a link that had no room


@dataclass(frozen=True)
class News:
    """Of a frame."""

    reached: MergeReached
    closed: TilesClosed
    tile_map: bytes


class MergeNews:
    """Only the newest counts: what has not left when the next comes is forgotten."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the next two
        self._newest: tuple[News, Sequence[Connection]] | None = None
        self._over = False
        self._told: dict[Connection, News] = {}  # the sending thread's
        self._thread = threading.Thread(target=self._send, name="tell of the merge", daemon=True)
        self._thread.start()

    def post(self, news: News, links: Sequence[Connection]) -> None:
        """Have it sent over these links."""
        with self._changed:
            self._newest = (news, links)
            self._changed.notify()

    def close(self) -> None:
        """End the thread. The links must be closed already: that wakes a send that waits."""
        with self._changed:
            self._over = True
            self._changed.notify()
        self._thread.join()

    def _send(self) -> None:
        late: Sequence[Connection] = ()
        news: News | None = None
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._over, RETRY_SECONDS if late else None)
                if self._over:
                    return
                if self._newest is not None:
                    (news, late), self._newest = self._newest, None
                    self._told = {link: self._told[link] for link in late if link in self._told}
            if news is not None:
                late = [link for link in late if not self._sent(news, link)]

    def _sent(self, news: News, link: Connection) -> bool:
        """False if the link has no room: a worker that does not read must not keep the news from others."""
        if not link.has_room:
            return link.closed
        told = self._told.get(link)
        with suppress(VolsplatError):  # who receives from it hears of the loss, and tells
            if told is None or (told.closed, told.tile_map) != (news.closed, news.tile_map):
                link.send(news.closed, news.tile_map)
            link.send(news.reached)  # the map first: whoever goes on by this knows what is hidden
            self._told[link] = news
        return True
