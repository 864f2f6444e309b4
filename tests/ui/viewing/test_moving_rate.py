"""The rate of pictures while something moves: what it is counted from, and how long it is told."""

import pytest

from volsplat.client.ui.viewing.moving_rate import LEAST, NEWS, SPAN, MovingRate


def noted(*times: float) -> MovingRate:
    rate = MovingRate()
    for time in times:
        rate.note(time)
    return rate


def test_it_is_the_pictures_of_the_last_seconds_whatever_was_before() -> None:
    slow, fast = [0.5 * n for n in range(8)], [3.5 + n / 30 for n in range(1, 91)]
    assert noted(*slow).rate == pytest.approx(2)
    assert noted(*slow, *fast).rate == pytest.approx(30)


def test_few_pictures_that_take_long_have_a_rate_too() -> None:
    assert noted(0, 1.5, 3, 4.5, 6).rate == pytest.approx(1 / 1.5)
    assert noted(0, 1.5, 3, 4.5, 6).left(6) > 0
    slowest = [SPAN * n for n in range(LEAST)]
    assert noted(*slowest).rate == pytest.approx(1 / SPAN) and noted(*slowest).left(slowest[-1]) > 0


def test_pictures_that_come_more_than_its_span_apart_have_none() -> None:
    slower = [1.25 * SPAN * n for n in range(3 * LEAST)]
    assert noted(*slower).left(slower[-1]) == 0


def test_a_hand_that_rests_for_a_moment_makes_it_no_slower() -> None:
    assert noted(*(n / 30 for n in range(15)), *(1 + n / 30 for n in range(15))).rate == pytest.approx(30)
    assert noted(0, 0.02, 0.1, 0.12, 0.2, 0.22, 0.3).rate == pytest.approx(20)  # what comes in pairs


def test_it_is_told_for_some_seconds_after_the_last_picture_and_not_of_a_click() -> None:
    times = [0.1 * n for n in range(LEAST)]
    assert noted().left(0) == noted(*times[1:]).left(0.3) == 0
    assert noted(*times).left(times[-1] + 1) == pytest.approx(NEWS - 1)
    assert noted(*times).left(times[-1] + NEWS + 1) == 0
    assert noted(*times, times[-1] + SPAN + 1).left(times[-1] + SPAN + 1) == 0  # a click long after it


def test_pictures_of_the_same_moment_have_a_rate() -> None:
    assert noted(*[7.0] * LEAST).rate > 0
