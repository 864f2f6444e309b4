"""Where the page's own scripts, styles and pictures lie."""

from functools import cache
from pathlib import Path

STATIC = Path(__file__).parents[1] / "static"

MODULES = {"volsplat": str(STATIC)}
"""What components import as `volsplat/…`: wherever the page is, NiceGUI tells the browser the address of these."""


@cache
def frame_styles() -> str:
    """The styles of every page's frame, as text."""
    return "\n".join((STATIC / name).read_text("utf-8") for name in ("theme.css", "page.css"))
