"""Which of the fonts that come with OpenImageIO has the characters of a line, for pixels and PDF."""

from __future__ import annotations

from typing import NamedTuple

from volsplat.client.figure.characters import LATIN, legible
from volsplat.client.image.lettering import BOLD_FONT, FONT, extent

WIDE_FONT = "DroidSansMono"  # has more than western Europe's letters


class Setting(NamedTuple):
    """A line as it is set: with characters that its font has."""

    text: str
    font: str


def setting_of(text: str, bold: bool = False) -> Setting:
    """Bold where the font that has the characters has a bold one."""
    text = legible(text)
    if LATIN.issuperset(text):
        return Setting(text, BOLD_FONT if bold else FONT)
    return Setting(text, WIDE_FONT)


def width_of(text: str, size: int, bold: bool = False) -> int:
    """In pixels."""
    set_as = setting_of(text, bold)
    return extent(set_as.text, size, set_as.font)


def size_within(text: str, size: int, room: float, bold: bool = False) -> int:
    """The size, or the greatest smaller one at which a line has room."""
    wide = width_of(text, size, bold)
    return size if wide <= room else max(int(size * room / wide), 1)
