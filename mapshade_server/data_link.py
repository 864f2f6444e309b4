"""The link to a splat server: batches go there, and from there comes word of what they may leave out.

Walkers send; a thread of the link's own hears which tiles of the image are closed.
"""

import threading
from typing import TYPE_CHECKING, NamedTuple

from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, new_tile_map, tile_map_bytes
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection, ConnectionClosed, Counters

if TYPE_CHECKING:
    from typing_extensions import Buffer


class FrameTiles(NamedTuple):
    """The map of closed tiles of a frame, as far as it is known here."""

    frame: int
    map: memoryview


class DataLink:
    """An open connection to the splat server at the end of a route."""

    def __init__(self, route: messages.Route, connection: Connection) -> None:
        self.route = route
        self._connection = connection
        self._tiles = FrameTiles(
            0, new_tile_map(1, 1)
        )  # replaced by the thread that begins frames, filled by the hearing one
        self._failure: VolsplatError | None = None  # how the splat server was lost
        self._hearing = threading.Thread(target=self._hear, name=f"receive from {connection.peer}", daemon=True)
        self._hearing.start()

    @property
    def closed(self) -> bool:
        return self._connection.closed

    @property
    def counters(self) -> Counters:
        return self._connection.counters

    def begin_frame(self, frame: int, tile_map: memoryview) -> None:
        """The splat server's lines of the map of closed tiles are filled from now on (see protocol.closed_tiles)."""
        self._tiles = FrameTiles(frame, tile_map)

    def send(self, batch: messages.Batch, *payload: "Buffer") -> None:
        """Raises PeerLost where the splat server is gone."""
        try:
            self._connection.send(batch, *payload)
        except ConnectionClosed as closed:
            self._hearing.join()  # it closed the connection, and is about to say why
            raise self._failure or closed from None

    def interrupt(self) -> None:
        """Close it from any thread: whoever sends is woken."""
        self._connection.close()

    def close(self) -> None:
        self._connection.close()
        self._hearing.join()

    def _hear(self) -> None:
        try:
            while (received := self._connection.receive()) is not None:
                HANDLERS[type(received.message)].method(self, *received)
        except VolsplatError as error:
            self._failure = error
        finally:
            self._connection.close()  # a link that nobody hears is lost

    @takes(messages.TilesClosed)
    def _close_tiles(self, message: messages.TilesClosed, payload: memoryview) -> None:
        tiles = self._tiles
        whole = tiles.map.cast("B")
        begin = message.begin // TILE_SIDE * tile_map_bytes(message.width, TILE_SIDE)
        if message.frame == tiles.frame and begin + len(payload) <= len(whole):
            whole[begin : begin + len(payload)] = payload


HANDLERS = handlers(DataLink)

check_handlers(taken_by(Role.DATA_LINK), DataLink)
