"""Where the page's own scripts, styles and pictures lie."""

from pathlib import Path

STATIC = Path(__file__).parents[1] / "static"

MODULES = {"volsplat": str(STATIC)}
"""What components import as `volsplat/…`: wherever the page is, NiceGUI tells the browser the address of these."""
