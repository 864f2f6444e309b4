"""The characters that the fonts of figures have. Imports no image library: words are refused before any work."""

from pathlib import Path
from unicodedata import normalize

from volsplat.client.figure.figure import Figure
from volsplat.protocol.text.errors import BadInput

SUBSTITUTES = {ord("−"): "–"}  # which has the width of a minus

LATIN = {*map(chr, [*range(0x20, 0x7F), *range(0xA0, 0x100)]), *"–—"}
MORE = {*map(chr, [*range(0x100, 0x180), *range(0x391, 0x3A2), *range(0x3A3, 0x3CA), *range(0x410, 0x450)])}
SIGNS = {*"‘’“”…†‡‰′″€™ℓ∂∆∏∑√∞∫≈≠≤≥"}


def check_words(figure: Figure, path: Path) -> None:
    """Raises BadInput, naming them, for characters of a person's words that no font has: SVG has its viewer's fonts."""
    words = "".join([figure.title, *(text for text, _ in figure.labels)]).translate(SUBSTITUTES)
    lacking = sorted({*words} - LATIN - MORE - SIGNS)
    if lacking and path.suffix.lower() != ".svg":
        named = ", ".join(f"{character!r}" for character in lacking[:5])
        raise BadInput(f"the fonts for figures do not have {named}; write SVG, which is shown in its viewer's fonts")


def legible(text: str) -> str:
    """A file's words in characters that a font has: what is raised or compound plain, and "?" for others."""
    text = text.translate(SUBSTITUTES)
    if LATIN.issuperset(text):
        return text
    have = LATIN | MORE | SIGNS
    plain = (one if one in have else normalize("NFKD", one).translate(SUBSTITUTES) for one in text)
    return "".join(one if one in have else "?" for one in "".join(plain))
