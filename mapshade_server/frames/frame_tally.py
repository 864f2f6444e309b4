"""What a frame costs a map/shade server."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from volsplat.program.peak_memory import peak_memory
from volsplat.program.this_machine import this_machine
from volsplat.protocol.messages import messages


@dataclass
class LinkTally:
    """What has gone to one splat server so far; see messages.LinkStats."""

    raw_bytes: int = 0
    bytes: int = 0
    sending_seconds: float = 0.0
    waiting_seconds: float = 0.0

    def add(self, other: "LinkTally") -> None:
        self.raw_bytes += other.raw_bytes
        self.bytes += other.bytes
        self.sending_seconds += other.sending_seconds
        self.waiting_seconds += other.waiting_seconds


@dataclass
class FrameTally:
    """What a frame has cost so far; see messages.MapShadeStats."""

    voxels_visited: int = 0
    packets: int = 0
    batches: int = 0
    planning_seconds: float = 0.0
    map_shade_seconds: float = 0.0
    coding_seconds: float = 0.0
    sending_seconds: float = 0.0
    waiting_seconds: float = 0.0
    links: defaultdict[int, LinkTally] = field(default_factory=lambda: defaultdict(LinkTally))  # by splat server

    def send(self, server: int, sent: LinkTally, coding_seconds: float) -> None:
        """Add what went to a splat server."""
        self.links[server].add(sent)
        self.coding_seconds += coding_seconds
        self.sending_seconds += sent.sending_seconds
        self.waiting_seconds += sent.waiting_seconds

    @staticmethod
    def of_walkers(tallies: "Sequence[FrameTally]") -> "FrameTally":
        """Of a frame that walkers shared: what they counted together, and the seconds of the busiest."""
        busiest = max(tallies, key=lambda tally: tally.map_shade_seconds + tally.sending_seconds)
        links: defaultdict[int, LinkTally] = defaultdict(LinkTally)
        for server, sent in (link for tally in tallies for link in tally.links.items()):
            links[server].add(sent)
        return replace(
            busiest,
            links=links,
            voxels_visited=sum(tally.voxels_visited for tally in tallies),
            packets=sum(tally.packets for tally in tallies),
            batches=sum(tally.batches for tally in tallies),
        )

    def stats(self) -> messages.MapShadeStats:
        links = {server: messages.LinkStats(**vars(sent)) for server, sent in self.links.items()}
        sums = {name: sum(getattr(link, name) for link in links.values()) for name in ("raw_bytes", "bytes")}
        counted = vars(self) | {"links": links} | sums
        return messages.MapShadeStats(**counted, peak_memory_bytes=peak_memory(), machine=this_machine())
