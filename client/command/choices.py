"""Words to choose from, as people type them: whatever the case; a word that is near one is told which."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

import click


class Words(click.Choice[str]):
    """One of some words, whatever the case."""

    def __init__(self, words: Iterable[str]) -> None:
        super().__init__([str(word) for word in words], case_sensitive=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            words = [str(word) for word in self.choices]
            self.fail(f"there is no {value!r} ({meant(str(value), words)})", param, error.ctx or ctx)


def meant(given: str, words: Sequence[str]) -> str:
    """Which of the words was likely meant, or all of them."""
    near = nearest(given, words)
    return f"did you mean {near}?" if near else f"choose from {', '.join(words)}"


def nearest(given: str, words: Sequence[str]) -> str | None:
    """The word that is most like this one, whatever the case; None if none is."""
    by_lower = {word.lower(): word for word in words}
    near = difflib.get_close_matches(given.lower(), list(by_lower), 1)
    return by_lower[near[0]] if near else None
