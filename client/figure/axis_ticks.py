"""Ticks of an axis at round numbers, and how they are written."""

import math

MINUS = "−"
MOST_DIGITS = 5  # before or after the point; beyond it numbers are written with their power of ten
LEAST_SIGNIFICANT = 6
STEPS = (1, 2, 5)
ROUNDING = 1e-9  # of a step, by which the end of an axis may miss the tick on it


def ticks(low: float, high: float, most: int) -> list[float]:
    """At most so many multiples of a round step from `low` to `high`, as close as that allows; `most` is at least 2.

    Round are 1, 2 and 5 times a power of ten.
    """
    if not low < high:
        return []
    exponent = math.floor(math.log10((high - low) / most)) - 1
    for power in range(exponent, exponent + 4):
        for factor in STEPS:
            step = float(f"{factor}e{power}")
            first, last = math.ceil(low / step - ROUNDING), math.floor(high / step + ROUNDING)
            if last - first < most:
                found = (float(f"{n * factor}e{power}") for n in range(first, last + 1))
                return [min(max(value, low), high) for value in found]
    raise AssertionError("a step of the whole range is tried")


def tick_texts(values: list[float]) -> list[str]:
    """All with as many digits after the point as the finest needs."""
    greatest = max(map(abs, values), default=0.0)
    step = min((after - before for before, after in zip(values, values[1:], strict=False)), default=greatest)
    if greatest == 0:
        return ["0"] * len(values)
    digits = max(-math.floor(math.log10(step) + 1e-9), 0)
    if digits > MOST_DIGITS or greatest >= 10.0**MOST_DIGITS * 10:
        significant = max(math.floor(math.log10(greatest)) - math.floor(math.log10(step) + 1e-9) + 1, LEAST_SIGNIFICANT)
        return [_plain(f"{value:.{significant}g}") for value in values]
    return [_plain(f"{value:.{digits}f}") for value in values]


def _plain(text: str) -> str:
    return text.replace("-", MINUS)
