"""One frame on its way: each walker, in a thread of its own, sends every splat server what reaches its regions."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence

from volsplat.mapshade_server.frames.frame_tally import FrameTally, LinkTally
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.links.data_link import DataLink, Sent
from volsplat.mapshade_server.links.shaded_batch import ShadedBatch
from volsplat.program.frame_spans import UNTRACED, FrameSpans
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.text.errors import PeerLost, RemoteProtocolError
from volsplat.protocol.wire.connection import ConnectionClosed

log = logging.getLogger(__name__)

LOSSES = (PeerLost, ConnectionClosed, RemoteProtocolError)
LEAST_SPAN = 1e-5  # seconds: what is shorter, where nothing may have been done, is not traced


class FrameDelivery:
    """The splat servers that are lost on the way get no more; once all are, the frame is over.

    Each batch goes to all of them, if only to tell how far its walker has come: else two workers could each fill a
    splat server that waits for word of the other.
    """

    def __init__(
        self,
        frame: int,
        worker: int,
        walk: FrameWalk,
        regions: Sequence[Region],
        links: Mapping[int, DataLink],
        wanted: Callable[[], bool],
        spans: FrameSpans = UNTRACED,
    ) -> None:
        """`worker` is this server; `wanted` tells whether the frame still is; what is done when goes into `spans`."""
        self._frame = frame
        self._worker = worker
        self._walk = walk
        self._links = links
        self._wanted = wanted
        self._spans = spans
        self._parts = _parts_of(regions)
        self._ended = False
        self._lost = self._parts.keys() - links.keys()

    @property
    def lost(self) -> list[int]:
        """Splat servers that did not get all."""
        return sorted(self._lost)

    def end(self) -> None:
        """Have the walkers stop before their next batches."""
        self._ended = True

    def walk(self, walker: int) -> FrameTally:
        """Walk and send, to the end or until it is of no use any more. One thread for each walker."""
        tally = FrameTally()
        outlets = [
            _Outlet(self._links[server], parts, walker)
            for server, parts in self._parts.items()
            if server in self._links
        ]
        last = False
        while not last and self._goes_on():
            self._wait_for_merge(walker, outlets, tally)
            started = time.perf_counter()
            batch = self._walk.walkers[walker].next_batch(min(outlet.pace.most_packets for outlet in outlets))
            ended = time.perf_counter()
            tally.map_shade_seconds += ended - started
            self._spans.note(_row(walker), "walk", started, ended)
            assert batch is not None, "the last batch has gone"
            last = batch.last
            tally.count(batch)
            for outlet in outlets:
                if outlet.server not in self._lost:
                    self._send(outlet, walker, batch, tally)
        return tally

    def _goes_on(self) -> bool:
        return not self._ended and self._wanted() and len(self._lost) < len(self._parts)

    def _wait_for_merge(self, walker: int, outlets: "Sequence[_Outlet]", tally: FrameTally) -> None:
        """Until every splat server is near enough to where the walker is."""
        for outlet in outlets:
            waited = outlet.pace.wait(walker, self._goes_on)
            if waited > 0.0:
                tally.wait(outlet.server, waited)
                ended = time.perf_counter()
                self._spans.note(_row(walker), f"wait for splat server {outlet.server}", ended - waited, ended)

    def _send(self, outlet: "_Outlet", walker: int, batch: ShadedBatch, tally: FrameTally) -> None:
        began = time.perf_counter()
        try:
            sent = outlet.send(self._frame, self._worker, batch, self._goes_on, tally)
        except LOSSES as loss:
            log.info("frame %d: %s", self._frame, loss)
            self._lost.add(outlet.server)
        else:
            self._note(_row(walker), outlet.server, began, sent)

    def _note(self, row: str, server: int, began: float, sent: Sent) -> None:
        """A batch was first coded, then sent; what it waited for, it waited for at last."""
        coded, ended = began + sent.coding_seconds, began + sent.coding_seconds + sent.seconds
        if sent.coding_seconds > LEAST_SPAN:
            self._spans.note(row, "code", began, coded)
        self._spans.note(row, f"send to splat server {server}", coded, ended)
        if sent.waiting_seconds > 0.0:
            self._spans.note(row, "wait for room", ended - sent.waiting_seconds, ended)


def _row(walker: int) -> str:
    return f"walker {walker}"


class _Outlet:
    """A walker's way to a splat server."""

    def __init__(self, link: DataLink, parts: slice, walker: int) -> None:
        self.server = link.route.server
        self.pace = link.pace
        self._link = link
        self._channel = link.channel(walker)
        self._parts = parts
        self._walker = walker
        self._sequence = 0

    def send(self, frame: int, worker: int, batch: ShadedBatch, wanted: Callable[[], bool], tally: FrameTally) -> Sent:
        if self._channel is not None:
            sent = self._link.send_through(self._channel, frame, batch, self._parts, wanted)
            raw_bytes = sent.nbytes
        else:
            message = self._message(frame, worker, batch)
            sent, raw_bytes = self._link.send(message, self._parts, batch), message.raw_bytes
        gone = LinkTally(raw_bytes, sent.nbytes, sent.seconds, sent.waiting_seconds)
        tally.send(self.server, gone, sent.coding_seconds)
        return sent

    def _message(self, frame: int, worker: int, batch: ShadedBatch) -> messages.Batch:
        sequence, self._sequence = self._sequence, self._sequence + 1
        return messages.Batch(
            frame=frame,
            worker=worker,
            walker=self._walker,
            sequence=sequence,
            coded_bytes=0,
            parts=[messages.BatchPart(part.run_count, part.packet_count) for part in batch.parts[self._parts]],
            reached_sheet=batch.reached[0],
            reached_row=batch.reached[1],
            last=batch.last,
        )


def _parts_of(regions: Sequence[Region]) -> dict[int, slice]:
    """Which of a batch's parts are for each splat server."""
    parts: dict[int, slice] = {}
    for number, region in enumerate(regions):
        first = parts[region.server].start if region.server in parts else number
        parts[region.server] = slice(first, number + 1)
    return parts
