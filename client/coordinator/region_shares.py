"""How the lines of an image are shared out among the splat servers: by what the frame before had to splat where."""

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

from volsplat.protocol.messages.frame_messages import RenderFrame, SplatStats
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.region_cuts import cut, expected_work, regions_each
from volsplat.protocol.rules.regions import Region

TELLING_SECONDS = 0.002  # of splatting: a server's rate is not known from less
NEWEST_WEIGHT = 0.5  # of the rate that was measured last


class RegionShares:
    """Rows of an image and columns of one that is turned have their own work: it is measured for each."""

    def __init__(self) -> None:
        self._work: dict[bool, list[int]] = {}  # splatted pixels of each row of tiles, for upright and turned images
        self._rates: dict[int, float] = {}  # splatted pixels a second of one owner, by server

    def regions(self, plan: FramePlan, owners: Mapping[int, int]) -> list[Region]:
        """As many for each owner of these servers, in their order; some may be empty."""
        each = regions_each(plan, sum(owners.values()))
        servers = [server for server, threads in owners.items() for _ in range(threads * each)]
        usual = sum(self._rates.values()) / len(self._rates) if self._rates else 1.0
        rates = [self._rates.get(server, usual) for server in servers]
        work = self._work.get(plan.turned) or expected_work(plan)
        edges = cut(work, plan.height, rates)
        return [Region(server, *lines) for server, lines in zip(servers, pairwise(edges), strict=True)]

    def measured(self, request: RenderFrame, stats: Mapping[int, SplatStats]) -> None:
        """Take what the splat servers of a finished frame report."""
        owners = Counter(region.server for region in request.regions)
        work = [pixels for server in owners for pixels in stats[server].work]
        if any(work):
            self._work[request.plan.turned] = work
        for server, threads in owners.items():
            seconds, pixels = stats[server].splat_seconds * threads, sum(stats[server].work)
            if seconds >= TELLING_SECONDS and pixels:
                rate, before = pixels / seconds, self._rates.get(server)
                self._rates[server] = rate if before is None else NEWEST_WEIGHT * rate + (1 - NEWEST_WEIGHT) * before

    def lose(self, server: int) -> None:
        """It draws no more."""
        self._rates.pop(server, None)
