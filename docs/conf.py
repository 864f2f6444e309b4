"""How Sphinx makes the site of these pages: `make docs`. The pictures come from the commands that the pages print."""

import os
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "tests"))  # which has what finds and runs the commands of a page

from support.programs.documented_commands import TYPED_BY_SITE, blocks  # noqa: E402
from support.programs.quick_shell import QuickShell  # noqa: E402

project = "volsplat"
html_title = "volsplat"
html_theme = "furo"  # light and dark; its fonts are the reader's own, so that a page loads nothing from elsewhere
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False  # LICENSE has it
highlight_language = "none"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_member_order = "bysource"
python_use_unqualified_type_names = True

MADE = HERE / "made"
LIMIT = 600  # seconds for a block of commands


def type_commands(app: Sphinx) -> None:
    """Does what the pages say, so that each command works and each picture is what it draws now."""
    with TemporaryDirectory() as folder, QuickShell(Path(folder), dict(os.environ)) as shell:
        for page in TYPED_BY_SITE:
            for block in blocks(page):
                lines = block.text.splitlines()
                ending = [line for line in lines if not line.startswith("volsplat view ")]
                done = shell.runs("\n".join(ending), LIMIT)
                if done.returncode != 0:
                    raise RuntimeError(f"{page}: this ends with status {done.returncode}:\n{done.args}\n{done.stdout}")
        _put_up(Path(folder))


def _put_up(folder: Path) -> None:
    """Each picture is replaced at once, and by the same: another build of these pages may be reading it."""
    MADE.mkdir(exist_ok=True)
    pictures = {picture.name: picture for picture in folder.glob("*.png")}
    for name, picture in pictures.items():
        copied = shutil.copyfile(picture, MADE / f"{name}.{os.getpid()}")
        copied.replace(MADE / name)
    for old in MADE.glob("*.png"):
        if old.name not in pictures:
            old.unlink(missing_ok=True)


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", type_commands)
    app.add_lexer("mermaid", TextLexer)  # diagrams are shown as they are written: drawing them takes a foreign script
