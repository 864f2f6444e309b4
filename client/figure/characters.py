"""The characters that the fonts of figures have. Imports no image library: words are refused before any work."""

from collections.abc import Iterable
from pathlib import Path

from volsplat.client.figure.figure import Figure
from volsplat.protocol.text.errors import BadInput

SUBSTITUTES = {ord("−"): "–"}  # which has the width of a minus

LATIN = {*map(chr, [*range(0x20, 0x7F), *range(0xA0, 0x100)]), *"–—"}
MORE = {*map(chr, [*range(0x100, 0x180), *range(0x391, 0x3A2), *range(0x3A3, 0x3CA), *range(0x410, 0x450)])}
SIGNS = {*"‘’“”…†‡‰′″€™ℓ∂∆∏∑√∞∫≈≠≤≥"}


def check_words(figure: Figure, path: Path) -> None:
    """Raises BadInput for words of a person that cannot be set in this kind of file: SVG has its viewer's fonts."""
    if path.suffix.lower() != ".svg":
        check_characters([figure.title, *(text for text, _ in figure.labels)])


def check_characters(texts: Iterable[str]) -> None:
    """Raises BadInput, naming them, for characters that no font has."""
    lacking = sorted({*"".join(texts).translate(SUBSTITUTES)} - LATIN - MORE - SIGNS)
    if lacking:
        named = ", ".join(f"{character!r}" for character in lacking[:5])
        raise BadInput(f"the fonts for figures do not have {named}; write SVG, which is shown in its viewer's fonts")
