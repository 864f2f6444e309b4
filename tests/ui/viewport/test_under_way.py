"""How many pictures are under way, over lines that are far, narrow, both or neither."""

from __future__ import annotations

import heapq

from hypothesis import example, given
from hypothesis import strategies as st

from volsplat.client.ui.viewport.under_way import LEAST, MOST, UnderWay

DRAWN = 1 / 30  # seconds from one picture to the next
SECONDS = 20.0


def carried(round_trip: float, sending: float) -> tuple[float, float]:
    """Pictures a second and the longest lag, once it has settled, of a line that takes `sending` seconds a picture."""
    under_way = UnderWay()
    line_free = 0.0
    unsent = False  # whether there is a picture that is newer than the last one sent
    number = 0
    lags: list[float] = []
    events: list[tuple[float, int]] = [(0.0, 0)]  # when a picture is drawn (0), or the page says it has one
    while events[0][0] < SECONDS:
        now, shown = heapq.heappop(events)
        if shown:
            under_way.shown(shown, now)
        else:
            unsent = True
            heapq.heappush(events, (now + DRAWN, 0))
        if unsent and under_way.may_send():
            number += 1
            under_way.sent(number, now)
            line_free = max(line_free, now) + sending
            unsent = False
            heapq.heappush(events, (line_free + round_trip, number))
            if now > SECONDS / 2:
                lags.append(line_free + round_trip - now)
    return len(lags) / (SECONDS / 2), max(lags)


@given(round_trip=st.floats(0.0, 0.3), sending=st.floats(0.0005, 0.5))
@example(round_trip=0.15, sending=0.0005)
@example(round_trip=0.04, sending=0.12)
def test_the_line_is_filled_and_nothing_queues_on_it(round_trip: float, sending: float) -> None:
    rate, lag = carried(round_trip, sending)
    assert rate >= 0.8 * min(1 / DRAWN, 1 / sending)
    # A picture waits for those before it, a few of which make up for the line's ends.
    assert lag <= 1.5 * round_trip + 3 * sending


def test_at_first_and_after_a_pause_two_are_under_way() -> None:
    under_way = UnderWay()
    assert under_way.most == LEAST
    for number in range(1, 41):
        under_way.sent(number, number / 100)
        if number > 30:
            under_way.shown(number - 30, number / 100)
    assert under_way.most == MOST
    under_way.shown(40, 0.7)
    under_way.sent(41, 60.0)
    assert under_way.most == LEAST


def test_what_is_dropped_makes_room_with_what_came_before_it() -> None:
    under_way = UnderWay()
    under_way.sent(1, 0.0)
    under_way.sent(2, 0.1)
    assert not under_way.may_send()
    under_way.shown(10**9, 0.2)  # numbers of pictures that were never sent tell nothing of the line
    assert under_way.may_send() and under_way.most == LEAST
