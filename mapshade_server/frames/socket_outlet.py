"""A walker's way to a splat server by the socket: of another machine, or where no memory can be shared."""

import logging
import time
from collections.abc import Callable, Sequence

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames.frame_tally import LinkTally
from volsplat.mapshade_server.links.data_link import DataLink, Sent
from volsplat.mapshade_server.links.shaded_part import ShadedPart, parts_of
from volsplat.program.frame_spans import FrameSpans
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import PeerLost, RemoteProtocolError
from volsplat.protocol.wire.connection import ConnectionClosed

log = logging.getLogger(__name__)

LOSSES = (PeerLost, ConnectionClosed, RemoteProtocolError)
LEAST_SPAN = 1e-5  # seconds: what is shorter, where nothing may have been done, is not traced


class SocketOutlet:
    """For the kernel's delivery, which calls it from a walker's thread."""

    def __init__(
        self,
        link: DataLink,
        frame: int,
        worker: int,
        walker: int,
        parts: slice,
        wanted: Callable[[], bool],
        spans: FrameSpans,
    ) -> None:
        """For these parts of the batches of a walker of this server, `worker`, while their frame is `wanted`."""
        self.tally = LinkTally()
        self.coding_seconds = 0.0
        self._link = link
        self._frame = frame
        self._worker = worker
        self._walker = walker
        self._parts = parts
        self._wanted = wanted
        self._spans = spans
        self._row = f"walker {walker}"
        self._sequence = 0

    def most_packets(self) -> float:
        """Of the next batch, once the splat server is near enough to where the walker is."""
        server, pace = self._link.route.server, self._link.pace
        waited = pace.wait(self._walker, self._wanted)
        if waited > 0.0:
            self.tally.add(LinkTally(sending_seconds=waited, waiting_seconds=waited))
            ended = time.perf_counter()
            self._spans.note(self._row, f"wait for splat server {server}", ended - waited, ended)
        return pace.most_packets

    def send(self, batch: _kernels.Batch) -> bool:
        """Send what of a batch is for the splat server. False if that is lost."""
        began, parts = time.perf_counter(), parts_of(batch)[self._parts]
        message = self._message(batch, parts)
        try:
            sent = self._link.send(message, parts)
        except LOSSES as loss:
            log.info("frame %d: %s", self._frame, loss)
            return False
        self.tally.add(LinkTally(message.raw_bytes, sent.nbytes, sent.seconds, sent.waiting_seconds))
        self.coding_seconds += sent.coding_seconds
        self._note(began, sent)
        return True

    def _note(self, began: float, sent: Sent) -> None:
        """A batch was first coded, then sent; what it waited for, it waited for at last."""
        coded, ended = began + sent.coding_seconds, began + sent.coding_seconds + sent.seconds
        if sent.coding_seconds > LEAST_SPAN:
            self._spans.note(self._row, "code", began, coded)
        self._spans.note(self._row, f"send to splat server {self._link.route.server}", coded, ended)
        if sent.waiting_seconds > 0.0:
            self._spans.note(self._row, "wait for room", ended - sent.waiting_seconds, ended)

    def _message(self, batch: _kernels.Batch, parts: Sequence[ShadedPart]) -> messages.Batch:
        sequence, self._sequence = self._sequence, self._sequence + 1
        return messages.Batch(
            frame=self._frame,
            worker=self._worker,
            walker=self._walker,
            sequence=sequence,
            coded_bytes=0,
            parts=[messages.BatchPart(part.run_count, part.packet_count) for part in parts],
            reached_sheet=batch.reached[0],
            reached_row=batch.reached[1],
            last=batch.last,
        )
