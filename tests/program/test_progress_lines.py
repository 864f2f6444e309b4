"""Lines of progress in a log: few, none for short work, and with the time that is really left."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.program.plain_console import PlainConsole
from volsplat.program.progress_lines import PAUSE, ProgressLines


def lines_of(seconds: list[float], words: str = "work") -> list[str]:
    """What is told of parts that take so many seconds each."""
    console, now = PlainConsole(stderr=True), 0.0
    lines = ProgressLines(console, len(seconds), words, lambda: now)
    with console.capture() as told:
        for done, one in enumerate(seconds, start=1):
            now += one
            lines.reach(done)
    return told.get().splitlines()


def test_the_time_left_is_that_of_the_parts_to_come_whatever_the_start_took() -> None:
    assert lines_of([100.0] + [15.0] * 9) == [
        "work: 2 of 10, about 2 min left",
        "work: 6 of 10, about 60 s left",
    ]
    assert lines_of([0.0, *[3600.0] * 4])[0] == "work: 2 of 5, about 3.0 h left"


def test_short_work_is_not_worth_a_line() -> None:
    assert lines_of([30.0] + [0.5] * 30) == [] and lines_of([1000.0]) == []


@given(st.lists(st.floats(0.0, 500.0), min_size=1, max_size=40))
def test_there_is_no_more_than_a_line_a_minute(seconds: list[float]) -> None:
    assert len(lines_of(seconds)) <= 1 + sum(seconds[1:]) / PAUSE


def test_words_of_a_volume_steer_no_terminal() -> None:
    (line, *_) = lines_of([0.0, 60.0, 60.0], "[red]\x1b[2J")
    assert line.startswith("[red]?[2J: 2 of 3")


@pytest.mark.parametrize("parts", [[5, 7, 20], [20]])
def test_parts_may_be_done_several_at_a_time(parts: list[int]) -> None:
    console, now = PlainConsole(stderr=True), 0.0
    lines = ProgressLines(console, 20, "starting", lambda: now)
    lines.describe("making sheets")
    with console.capture() as told:
        for done in parts:
            now += 10.0
            lines.reach(done)
    assert told.get() == ("making sheets: 7 of 20, about 60 s left\n" if len(parts) > 1 else "")


@pytest.mark.parametrize("stop", [3600.0, 12 * 3600.0])
def test_a_stop_is_forgotten_after_one_line(stop: float) -> None:
    """As a terminal's stop, or a machine's sleep where the clock goes on."""
    told = lines_of([10.0] * 20 + [10.0 + stop] + [10.0] * 39)
    (with_the_stop,) = (n for n, line in enumerate(told) if line.endswith("h left"))
    assert told[with_the_stop + 1 :][:2] == ["work: 27 of 60, about 6 min left", "work: 33 of 60, about 4 min left"]
