"""One frame on its way: has the kernels' walkers send every splat server what reaches its regions, and counts it."""

import logging
from collections.abc import Callable, Mapping, Sequence

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames.frame_tally import FrameTally, LinkTally
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.frames.socket_outlet import LEAST_SPAN, SocketOutlet
from volsplat.mapshade_server.links.data_link import DataLink
from volsplat.program.frame_spans import FrameSpans, clock
from volsplat.protocol.messages.frame_messages import RenderFrame
from volsplat.protocol.rules.regions import Region

log = logging.getLogger(__name__)

Outlet = _kernels.ChannelOutlet | SocketOutlet


class FrameDelivery:
    """See kernels/delivery/delivery.h."""

    def __init__(
        self,
        request: RenderFrame,
        worker: int,
        walk: FrameWalk,
        links: Mapping[int, DataLink],
        newest: _kernels.NewestFrame,
        spans: FrameSpans,
    ) -> None:
        """`worker` is this server. The frame is wanted while none is newer; what is done when goes into `spans`."""
        self._frame = request.frame
        self._worker = worker
        self._walk = walk
        self._spans = spans
        self._wanted = _kernels.StillWanted(newest, request.frame)
        parts = _parts_of(request.regions)
        self._links = {server: links.get(server) for server in parts}
        self._outlets = [
            {server: self._outlet(walker, server, parts[server]) for server in parts}
            for walker in range(len(walk.walkers))
        ]
        self._kernel = _kernels.Delivery(
            walk.walkers,
            [list(outlets.values()) for outlets in self._outlets],
            self._wanted,
        )

    def _outlet(self, walker: int, server: int, parts: slice) -> Outlet | None:
        if (link := self._links[server]) is None:
            return None
        if (channel := link.channel(walker)) is not None:
            tiles = self._walk.closed_tiles
            return _kernels.ChannelOutlet(channel, self._frame, parts.start, parts.stop, tiles, self._wanted)
        return SocketOutlet(link, self._frame, self._worker, walker, parts, self._wanted, self._spans)

    @property
    def lost(self) -> list[int]:
        """Splat servers that did not get all."""
        return sorted(server for number, server in enumerate(self._links) if self._kernel.lost(number))

    def end(self) -> None:
        """Have the walkers stop before their next batches."""
        self._wanted.end()

    @property
    def failed(self) -> bool:
        """Whether a walker has; others may take longer to end."""
        return self._kernel.failed

    def check(self) -> None:
        """Raises what the first one failed of, if one has. Once."""
        self._kernel.check()

    def run(self, crew: _kernels.Crew, on_failure: Callable[[], None]) -> FrameTally:
        """Walk and send, to the end or until it is of no use any more. `on_failure` is called once it has `failed`."""
        self._kernel.run(crew, on_failure)
        for server in self.lost:
            if (link := self._links[server]) is not None and link.channel(0) is not None:
                log.info("frame %d: %s", self._frame, link.why_lost())
        if self._spans.wanted:
            self._note()
        return FrameTally.of_walkers([self._tally(walker) for walker in range(len(self._outlets))])

    def _tally(self, walker: int) -> FrameTally:
        walked = self._kernel.tally(walker)
        tally = FrameTally(walked.voxels, walked.packets, walked.batches, map_shade_seconds=walked.seconds)
        for server, outlet in self._outlets[walker].items():
            if isinstance(outlet, SocketOutlet):
                tally.send(server, outlet.tally, outlet.coding_seconds)
            elif outlet is not None:
                sent = LinkTally(outlet.bytes, outlet.bytes, outlet.seconds, outlet.waiting_seconds)
                tally.send(server, sent, 0.0)
        return tally

    def _note(self) -> None:
        """When the kernels did what."""
        ahead = clock() - _kernels.span_clock()
        for walker, outlets in enumerate(self._outlets):
            row = f"walker {walker}"
            for began, ended in self._kernel.spans(walker):
                self._spans.note(row, "walk", began + ahead, ended + ahead)
            for server, outlet in outlets.items():
                for began, full, ended in outlet.spans if isinstance(outlet, _kernels.ChannelOutlet) else ():
                    self._spans.note(row, f"send to splat server {server}", began + ahead, ended + ahead)
                    if ended - full > LEAST_SPAN:
                        self._spans.note(row, "wait for room", full + ahead, ended + ahead)


def _parts_of(regions: Sequence[Region]) -> dict[int, slice]:
    """Which of a batch's parts are for each splat server."""
    parts: dict[int, slice] = {}
    for number, region in enumerate(regions):
        first = parts[region.server].start if region.server in parts else number
        parts[region.server] = slice(first, number + 1)
    return parts
