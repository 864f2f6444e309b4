"""Which of the words that are known a person meant by another one."""

import difflib
from collections.abc import Sequence


def meant(given: str, words: Sequence[str], otherwise: str = "") -> str:
    """Which of the words was likely meant; else what is said `otherwise`, or all of them."""
    near = nearest(given, words)
    return f"did you mean {near}?" if near else otherwise or f"choose from {', '.join(words)}"


def nearest(given: str, words: Sequence[str]) -> str | None:
    """The word that is most like this one, whatever the case; None if none is."""
    by_lower = {word.lower(): word for word in words}
    near = difflib.get_close_matches(given.lower(), list(by_lower), 1)
    return by_lower[near[0]] if near else None
