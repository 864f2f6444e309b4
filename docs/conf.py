"""How Sphinx makes the site of these pages: `make docs`. The pictures come from the commands that the pages print."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))  # which finds what a page tells its readers to type

from support.programs.documented_commands import blocks  # noqa: E402

project = "volsplat"
html_title = "volsplat"
html_theme = "furo"  # light and dark; its fonts are the reader's own, so that a page loads nothing from elsewhere
html_copy_source = False
html_show_sphinx = False
highlight_language = "none"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True

# Typed from top to bottom, one page after the other, in one folder: a reader who follows the site has the same files.
TYPED = ("start/tour.md", "howto/fog.md", "howto/movie.md", "howto/batch.md", "howto/large.md")
MADE = HERE / "made"
LIMIT = 600  # seconds for a block of commands


def type_commands(app: Sphinx) -> None:
    """Does what the pages say, so that each command works and each picture is what it draws now."""
    shutil.rmtree(MADE, ignore_errors=True)
    MADE.mkdir()
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    for page in TYPED:
        for block in blocks(f"docs/{page}"):
            lines = [line for line in block.text.splitlines() if not line.startswith("volsplat view ")]  # has no end
            script = "set -e\n" + "\n".join(lines)
            done = subprocess.run(
                ["bash", "-c", script], cwd=MADE, env=environment, capture_output=True, encoding="utf-8", timeout=LIMIT
            )
            if done.returncode != 0:
                raise RuntimeError(f"{page}: this fails with status {done.returncode}:\n{script}\n{done.stderr}")


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", type_commands)
    app.add_lexer("mermaid", TextLexer)  # diagrams are shown as they are written: drawing them takes a foreign script
