"""Walkers that wait for the merge: never far ahead of it, and never all of them at once."""

import math
import random
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.patience import PATIENCE
from volsplat.mapshade_server.links.link_pace import LEAST_PACKETS, LinkPace

WINDOW = 40 << 10
BATCH = 15 << 10


def paced(carried: float = WINDOW, walkers: int = 1) -> LinkPace:
    pace = LinkPace(lambda: carried)
    pace.begin_frame(1, walkers)
    return pace


def goes_on(pace: LinkPace, walker: int) -> bool:
    """Whether it would not wait at all."""
    waits: list[bool] = []

    def never_mind() -> bool:
        waits.append(True)
        return False

    pace.wait(walker, wanted=never_mind)
    return not waits


@given(
    walkers=st.integers(1, 5),
    servers=st.integers(1, 3),
    sheets=st.integers(1, 40),
    seed=st.integers(0, 1 << 32),
)
def test_whoever_is_furthest_behind_goes_on_and_nobody_is_far_ahead(
    walkers: int, servers: int, sheets: int, seed: int
) -> None:
    """Whatever order batches and news come in: a frame of walkers of several servers ends."""
    chance = random.Random(seed)
    links = [paced() for _ in range(servers)]
    reached = dict.fromkeys(range(walkers), 0)
    sent: list[tuple[int, int]] = []  # walker, sheet
    splatted = [0] * servers
    while (behind := min(reached.values())) < sheets:
        free = [walker for walker in reached if reached[walker] < sheets and all(goes_on(one, walker) for one in links)]
        if free and chance.random() < 0.7:
            walker = chance.choice(free)
            reached[walker] = min(sheets, reached[walker] + chance.randint(1, 4))
            sent.append((walker, reached[walker]))
            for link in links:
                link.sent(walker, (reached[walker], 0), BATCH, LEAST_PACKETS)
        else:  # a splat server has splatted what can be, and says so
            number = chance.randrange(servers)
            splatted[number] = behind
            links[number].splatted(1, (behind, 0))
        for walker in reached:
            for place in splatted:
                assert BATCH * sent_beyond(sent, walker, place) < WINDOW + BATCH
        if set(splatted) == {behind}:
            assert all(goes_on(link, walker) for link in links for walker in reached if reached[walker] == behind)


def sent_beyond(sent: list[tuple[int, int]], walker: int, place: int) -> int:
    return sum(one == walker and sheet > place for one, sheet in sent)


def test_news_that_are_faster_than_the_note_of_what_was_sent_count() -> None:
    pace = paced()
    pace.splatted(1, (7, 3))
    for _ in range(4):
        pace.sent(0, (7, 3), BATCH, LEAST_PACKETS)
    assert goes_on(pace, 0)


def test_news_of_another_frame_are_of_no_use() -> None:
    pace = paced()
    for row in range(4):
        pace.sent(0, (1, row + 1), BATCH, LEAST_PACKETS)
    pace.splatted(2, (9, 9))
    assert not goes_on(pace, 0)
    pace.begin_frame(2, 1)
    assert goes_on(pace, 0)


@pytest.mark.parametrize("walkers", [0, 1])
def test_nobody_waits_in_a_frame_that_is_not_paced_or_over_a_link_that_is_no_hindrance(walkers: int) -> None:
    pace = paced(math.inf if walkers else WINDOW, walkers)
    for row in range(1000):
        pace.sent(0, (1, row + 1), BATCH, LEAST_PACKETS)
    assert goes_on(pace, 0)
    assert pace.most_packets == math.inf


def test_batches_are_small_beside_what_may_be_under_way_and_no_smaller_than_pays() -> None:
    pace = paced(carried=1 << 20, walkers=2)
    assert LEAST_PACKETS < pace.most_packets < WINDOW
    before = pace.most_packets
    for _ in range(20):
        pace.sent(0, (1, 1), 2 * LEAST_PACKETS, LEAST_PACKETS)  # coded, to a quarter
    assert pace.most_packets > 2 * before
    assert paced(carried=1.0).most_packets == LEAST_PACKETS
    assert goes_on(paced(carried=1.0), 0)


def test_a_walker_that_waits_goes_on_as_soon_as_there_is_news() -> None:
    pace = paced()
    for row in range(4):
        pace.sent(0, (1, row + 1), BATCH, LEAST_PACKETS)
    waited: list[float] = []
    walker = threading.Thread(target=lambda: waited.append(pace.wait(0, wanted=lambda: True)))
    walker.start()
    pace.splatted(1, (1, 4))
    walker.join(PATIENCE)
    assert waited and not walker.is_alive()


def test_a_link_that_has_ended_holds_nobody_back() -> None:
    pace = paced()
    for row in range(4):
        pace.sent(0, (1, row + 1), BATCH, LEAST_PACKETS)
    waited: list[float] = []
    walker = threading.Thread(target=lambda: waited.append(pace.wait(0, wanted=lambda: True)))
    walker.start()
    pace.end()
    walker.join(PATIENCE)
    assert waited and not walker.is_alive()
    pace.begin_frame(2, 1)
    for row in range(4):
        pace.sent(0, (1, row + 1), BATCH, LEAST_PACKETS)
    assert goes_on(pace, 0)
