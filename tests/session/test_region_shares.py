"""How an image is shared out from frame to frame: every owner has a region, and the slow have less to do."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.messages.coordinated import SPLAT_STATS
from support.messages.message_samples import SAMPLES
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.regions import Region, check_regions, lines_of

SAMPLE = SAMPLES[messages.RenderFrame][0]
assert isinstance(SAMPLE, messages.RenderFrame)
ROWS = 200  # of tiles
owners = st.dictionaries(st.integers(1, 9), st.integers(1, 5), min_size=1, max_size=4)


def plan(rows: int = ROWS, turned: bool = False) -> FramePlan:
    assert isinstance(SAMPLE, messages.RenderFrame)
    return msgspec.structs.replace(SAMPLE.drawing.plan, height=rows * TILE_SIDE, turned=turned, edges=())


def request(regions: list[Region], drawn: FramePlan) -> messages.RenderFrame:
    assert isinstance(SAMPLE, messages.RenderFrame)
    return msgspec.structs.replace(SAMPLE, drawing=msgspec.structs.replace(SAMPLE.drawing, plan=drawn), regions=regions)


def draw(
    shares: RegionShares, drawn: FramePlan, threads: dict[int, int], work: list[int], rates: dict[int, float]
) -> dict[int, float]:
    """Have a frame with this work, by row of tiles, drawn at these rates of an owner; seconds by server."""
    regions = shares.regions(drawn, threads)
    stats, seconds = {}, {}
    for server in threads:
        begin, end = (-(-line // TILE_SIDE) for line in lines_of(regions, server))
        own = work[begin:end]
        seconds[server] = sum(own) / rates[server] / threads[server]
        stats[server] = msgspec.structs.replace(SPLAT_STATS, work=own, splat_seconds=seconds[server])
    shares.measured(request(regions, drawn), stats)
    return seconds


@given(owners, st.integers(1, 60), st.booleans(), st.data())
def test_every_owner_has_a_region_in_any_frame(
    threads: dict[int, int], rows: int, turned: bool, data: st.DataObject
) -> None:
    shares = RegionShares()
    for _ in range(3):
        regions = shares.regions(plan(rows, turned), threads)
        check_regions(regions, rows * TILE_SIDE)
        assert [region.server for region in regions] == [server for server, n in threads.items() for _ in range(n)]
        work = data.draw(st.lists(st.integers(0, 10**9), min_size=rows, max_size=rows))
        draw(shares, plan(rows, turned), threads, work, dict.fromkeys(threads, 1e6))


@pytest.mark.parametrize("slow", [1.0, 0.5, 0.2])
@pytest.mark.parametrize("threads", [{1: 1, 2: 1}, {1: 4, 2: 1, 3: 2}])
def test_servers_of_any_speed_soon_take_as_long(slow: float, threads: dict[int, int]) -> None:
    shares, work = RegionShares(), [1000 + 7 * row for row in range(ROWS)]
    rates = {server: 1e6 * (slow if server == 1 else 1.0) for server in threads}
    for _ in range(8):
        seconds = draw(shares, plan(), threads, work, rates)
    assert max(seconds.values()) < 1.1 * min(seconds.values())


def test_an_image_that_is_turned_has_its_own_work() -> None:
    shares, threads = RegionShares(), {1: 1, 2: 1}
    upright, turned = [1] + [0] * (ROWS - 1), [0] * (ROWS - 1) + [1]
    for drawn, work in ((plan(), upright), (plan(turned=True), turned)):
        draw(shares, drawn, threads, [10**6 * part for part in work], {1: 1e6, 2: 1e6})
    assert lines_of(shares.regions(plan(), threads), 1)[1] <= TILE_SIDE
    assert lines_of(shares.regions(plan(turned=True), threads), 1)[1] >= (ROWS - 1) * TILE_SIDE


def test_the_rate_of_a_server_that_is_lost_counts_no_more() -> None:
    shares, threads = RegionShares(), {1: 1, 2: 1}
    for _ in range(4):
        draw(shares, plan(), threads, [10**4] * ROWS, {1: 1e6, 2: 1e5})
    even = lines_of(shares.regions(plan(), {1: 1, 3: 1}), 1)[1]
    assert abs(even - ROWS * TILE_SIDE // 2) <= TILE_SIDE, "of a new one nothing is known"
