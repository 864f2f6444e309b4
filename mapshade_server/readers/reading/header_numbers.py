"""Whole numbers in headers, and names of files that are numbered by them: small and few enough to be meant."""

import re
from collections.abc import Sequence

MOST_FILES = 1 << 16  # of a volume, by one pattern
_WHOLE_NUMBER = re.compile(r"[+-]?[0-9]{1,18}")  # which 64 bits hold
_PATTERN = re.compile(r"(?:[^%]|%%)*%[0-9]{0,2}d(?:[^%]|%%)*")


def whole_numbers(words: Sequence[str]) -> tuple[int, ...]:
    """Raises ValueError, with what is wrong, for what is none."""
    if not all(_WHOLE_NUMBER.fullmatch(word) for word in words):
        raise ValueError("is not a list of whole numbers")
    return tuple(int(word) for word in words)


def numbered_names(pattern: str, numbers: Sequence[str], slices: int) -> list[str]:
    """The names of files with so many slices: a pattern as slice%03d.raw, from the first number to the last by a step.

    Raises ValueError, with what is wrong, for what cannot be meant.
    """
    if not _PATTERN.fullmatch(pattern):
        raise ValueError("should have one number in the name, as slice%03d.raw")
    first, last, step = whole_numbers(numbers)
    if step == 0:
        raise ValueError("has a step of 0")
    every = range(first, last + (1 if step > 0 else -1), step)
    if not 0 < len(every) <= min(slices, MOST_FILES):
        raise ValueError(f"names {len(every)} files for {slices} slices")
    return [pattern % number for number in every]
