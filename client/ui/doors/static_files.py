"""Where the page's own scripts, styles and pictures lie."""

from pathlib import Path

STATIC = Path(__file__).parents[1] / "static"
