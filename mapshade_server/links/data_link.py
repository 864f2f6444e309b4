"""The link to a splat server: batches go there, and from there comes word of what they may leave out.

Walkers send; a thread of the link's own hears which tiles of the image are closed.
"""

import math
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from volsplat.mapshade_server._kernels import BatchChannel
from volsplat.mapshade_server.links.channels import shared_channels
from volsplat.mapshade_server.links.link_coding import LinkCoding
from volsplat.mapshade_server.links.link_pace import LinkPace
from volsplat.mapshade_server.links.shaded_part import ShadedPart
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import check_handlers, handlers, takes
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, new_tile_map, tile_map_bytes
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.protocol.wire.peer import Counters

NEWS_SECONDS = 0.012  # from when a batch has come until there is news of it: splatting, and the time between two news


class FrameTiles(NamedTuple):
    """The map of closed tiles of a frame, as far as it is known here."""

    frame: int
    map: memoryview


class Sent(NamedTuple):
    """What it took to send a batch."""

    nbytes: int
    coding_seconds: float
    seconds: float
    waiting_seconds: float  # of these, for the splat server or the network


class DataLink:
    """An open connection to the splat server at the end of a route, for so many walkers."""

    def __init__(self, route: messages.Route, connection: Connection, walkers: int = 1) -> None:
        self.route = route
        self._connection = connection
        # Replaced by the thread that begins frames, filled by the hearing one
        self._tiles = FrameTiles(0, new_tile_map(1, 1))
        self._failure: VolsplatError | None = None  # how the splat server was lost
        self._coding = None if connection.may_share_memory else LinkCoding()  # within a machine nothing is gained
        self._channels = shared_channels(connection, walkers)
        self.pace = LinkPace(self._carried_meanwhile)
        self._hearing = threading.Thread(target=self._hear, name=f"receive from {connection.peer}", daemon=True)
        self._hearing.start()

    @property
    def closed(self) -> bool:
        return self._connection.closed

    @property
    def counters(self) -> Counters:
        return self._connection.counters

    def begin_frame(self, frame: int, plan: FramePlan, tile_map: memoryview, paced_walkers: int) -> None:
        """The splat server's lines of the map of closed tiles are filled from now on (see protocol.closed_tiles)."""
        self._tiles = FrameTiles(frame, tile_map)
        self.pace.begin_frame(frame, paced_walkers)
        if self._coding is not None:
            self._coding.begin_frame(plan)

    def channel(self, walker: int) -> BatchChannel | None:
        """By which the walker's batches go; None if that is the socket."""
        return self._channels[walker] if walker < len(self._channels) else None

    def why_lost(self) -> VolsplatError:
        """Once it is closed: by whom, and why."""
        self._hearing.join()  # it closed the connection, and is about to say
        return self._failure or ConnectionClosed(f"{self._connection}: this side has closed the connection")

    def send(self, batch: messages.Batch, parts: Sequence[ShadedPart]) -> Sent:
        """Send a batch of these parts by the socket, coded if so it is there sooner.

        Raises PeerLost if the splat server is gone.
        """
        began = time.perf_counter()
        coded = self._coding.coded(batch, parts) if self._coding is not None else None
        if coded is not None:
            batch = msgspec.structs.replace(batch, coded_bytes=len(coded))
        sending, waited = time.perf_counter(), self.counters.seconds_in_send
        try:
            if coded is not None:
                self._connection.send(batch, coded)
            else:
                self._connection.send(batch, *(memory for part in parts for memory in (part.runs, part.packets)))
        except ConnectionClosed:
            raise self.why_lost() from None
        ended, waited = time.perf_counter(), self.counters.seconds_in_send - waited
        packets = sum(part.packet_count for part in parts)
        self.pace.sent(batch.walker, (batch.reached_sheet, batch.reached_row), batch.payload_bytes(), packets)
        if self._coding is not None:
            self._coding.choice.sent(batch.raw_bytes, batch.payload_bytes(), waited > 0, ended)
        seconds = ended - sending
        return Sent(batch.payload_bytes(), sending - began, seconds, min(seconds, waited))  # another walker waits, too

    def _carried_meanwhile(self) -> float:
        """Bytes that it carries until there is news of what was sent; without end if it is no hindrance."""
        seconds_per_byte = self._coding.choice.seconds_per_byte if self._coding is not None else 0.0
        if seconds_per_byte == 0.0:
            return math.inf
        return (self._connection.round_trip + NEWS_SECONDS) / seconds_per_byte

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
            for channel in self._channels:
                channel.close()
            self.pace.end()

    @takes(messages.TilesClosed)
    def _close_tiles(self, message: messages.TilesClosed, payload: memoryview) -> None:
        tiles = self._tiles
        whole = tiles.map.cast("B")
        begin = message.begin // TILE_SIDE * tile_map_bytes(message.width, TILE_SIDE)
        if message.frame == tiles.frame and begin + len(payload) <= len(whole):
            whole[begin : begin + len(payload)] = payload

    @takes(messages.MergeReached)
    def _follow_merge(self, message: messages.MergeReached, _: memoryview) -> None:
        self.pace.splatted(message.frame, (message.sheet, message.row))


HANDLERS = handlers(DataLink)

check_handlers(taken_by(Role.DATA_LINK), DataLink)
