"""How the plots write the data's values: what is read is the value, to what the axis can tell."""

from __future__ import annotations

from typing import Any

import pytest

from support.pages.tables_tab import Tab

ENTRIES = 256
AXES = [
    (1000.0, 2e7),
    (0.0, 3.4e20),
    (-2.5e10, 3e10),
    (1e9, 1.0001e9),
    (-2e-10, 1e-9),
    (2e-5, 9e-4),
    (-1000.0, 1550.0),
    (0.0, 1.0),
    (120_000.0, 130_000.0),
    (1_234_500.0, 1_234_600.0),
    (-130_000.0, -120_000.0),
    (-1e5, 1e5),
]


def by(tab: Tab, function: str, calls: list[Any]) -> list[Any]:
    """What a function of the module gives for each list of arguments."""
    script = """async ([name, calls]) => {
        const numbers = await import('/volsplat/static/tables/table_numbers.js');
        return calls.map((given) => numbers[name](...given));
    }"""
    found: list[Any] = tab.page.evaluate(script, [function, calls])
    return found


def read(text: str) -> float:
    return float(text.replace("−", "-"))


@pytest.mark.parametrize(("low", "high"), AXES)
def test_a_value_is_written_to_the_resolution_of_its_axis(tab: Tab, low: float, high: float) -> None:
    step = (high - low) / (ENTRIES - 1)
    values = [low + step * n for n in range(ENTRIES)] + [value for value in (0.0, 1500.0) if low <= value <= high]
    for function in ("dataText", "endText"):
        texts = by(tab, function, [(value, low, high) for value in values])
        for value, text in zip(values, texts, strict=True):
            assert abs(read(text) - value) <= step / 2 * 1.000001, text


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (1.234e-10, 0.0, 1e-9, "1.234e-10"),
        (3.217e20, 0.0, 3.4e20, "3.217e20"),
        (2.345e10, 0.0, 3e10, "2.345e10"),
        (-2e10, -2e10, 3e10, "−2e10"),
        (1500.0, 1000.0, 2e7, "1500"),
        (0.0, 0.0, 2e7, "0"),
    ],
)
def test_only_zeros_that_say_nothing_are_left_out(tab: Tab, value: float, low: float, high: float, text: str) -> None:
    assert by(tab, "dataText", [(value, low, high)]) == [text]


@pytest.mark.parametrize(("low", "high"), AXES)
def test_the_marks_of_an_axis_are_told_apart(tab: Tab, low: float, high: float) -> None:
    (marks,) = by(tab, "ticks", [(low, high, 5)])
    assert len(marks) > 1
    step = marks[1]["value"] - marks[0]["value"]
    for mark in marks:
        assert read(mark["text"]) == pytest.approx(mark["value"], abs=step * 1e-6)
