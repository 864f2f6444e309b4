"""Words to choose from, as people type them: whatever the case; a word that is near one is told which."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import click

from volsplat.protocol.text.meant import meant


class Words(click.Choice[str]):
    """One of some words, whatever the case."""

    def __init__(self, words: Iterable[str]) -> None:
        super().__init__([str(word) for word in words], case_sensitive=False)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str | None:
        """The words as they are written everywhere else; click would list them in small letters."""
        return click.Choice(self.choices).get_metavar(param, ctx)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            words = [str(word) for word in self.choices]
            self.fail(f"there is no {value!r} ({meant(str(value), words)})", param, error.ctx or ctx)
