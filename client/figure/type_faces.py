"""Which of the fonts that come with OpenImageIO have the characters of a line, for pixels and PDF."""

from __future__ import annotations

from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

from volsplat.client.figure.characters import LATIN, legible
from volsplat.client.image.lettering import BOLD_FONT, FONT, extent

WIDE_FONT = "DroidSansMono"  # has more than western Europe's letters
REMEMBERED = 1024  # lines' widths: the words of a movie are measured for each place in each frame


class Run(NamedTuple):
    """Characters of a line that one font has."""

    text: str
    font: str


def runs_of(text: str, bold: bool = False) -> list[Run]:
    """A line as it is set: what the usual font does not have in another, which has no bold one."""
    face = BOLD_FONT if bold else FONT
    fonts = groupby(legible(text), lambda character: face if character in LATIN else WIDE_FONT)
    return [Run("".join(characters), font) for font, characters in fonts]


@lru_cache(REMEMBERED)
def width_of(text: str, size: int, bold: bool = False) -> int:
    """In pixels."""
    runs = runs_of(text, bold)
    return extent(runs[0].text, size, runs[0].font) if len(runs) == 1 else sum(advance(run, size) for run in runs)


def advance(run: Run, size: int) -> int:
    """Pixels from its beginning to that of what follows, its outer blanks with it, which have no ink."""
    return extent(f"|{run.text}|", size, run.font) - extent("||", size, run.font)


def size_within(text: str, size: int, room: float, bold: bool = False) -> int:
    """The size, or the greatest smaller one at which a line has room."""
    wide = width_of(text, size, bold)
    return size if wide <= room else max(int(size * room / wide), 1)
