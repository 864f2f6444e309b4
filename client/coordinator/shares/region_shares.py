"""How the lines of an image are shared out among the splat servers: by what the frame before had to splat where."""

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise

from volsplat.client.coordinator.shares.measured_speeds import MeasuredSpeeds
from volsplat.protocol.messages.frame_messages import RenderFrame, SplatStats
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.region_cuts import cut, expected_work, regions_each
from volsplat.protocol.rules.regions import Region


class RegionShares:
    """Rows of an image and columns of one that is turned have their own work: it is measured for each."""

    def __init__(self) -> None:
        self._work: dict[bool, list[int]] = {}  # splatted pixels of each row of tiles, for upright and turned images
        self._speeds = MeasuredSpeeds()  # splatted pixels a second of one owner

    def regions(self, plan: FramePlan, owners: Mapping[int, int]) -> list[Region]:
        """As many for each owner of these servers, in their order; some may be empty."""
        each = regions_each(plan, sum(owners.values()))
        servers = [server for server, threads in owners.items() for _ in range(threads * each)]
        speeds = self._speeds.of(owners)
        work = self._work.get(plan.turned) or expected_work(plan)
        edges = cut(work, plan.height, [speeds[server] for server in servers])
        return [Region(server, *lines) for server, lines in zip(servers, pairwise(edges), strict=True)]

    def measured(self, request: RenderFrame, stats: Mapping[int, SplatStats]) -> None:
        """Take what the splat servers of a finished frame report."""
        owners = Counter(region.server for region in request.regions)
        work = [pixels for server in owners for pixels in stats[server].work]
        if any(work):
            self._work[request.drawing.plan.turned] = work
        for server, threads in owners.items():
            self._speeds.note(server, sum(stats[server].work), stats[server].splat_seconds * threads)
