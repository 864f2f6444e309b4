"""The page's modules, which no compiler sees on their way: their types hold, those of all that is said among them.

What page and process say to each other is declared once, in viewport_messages.py. A message that is missing from the
types is found here by a comparison; one that the page does not take, or that nobody takes from it, by TypeScript's
compiler, which deno brings; one that the process does not take by mypy (assert_never in viewport_talk.py).
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.pages.message_types import WRITTEN, message_types

CONFIG = ROOT / "tests/support/pages/page_modules.json"
VIEWPORT = ROOT / "client/ui/static/viewport"


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the compiler keeps its notes, for all tests here."""
    return tmp_path_factory.mktemp("deno")


def complaints(config: Path, *modules: Path, cache: Path) -> str:
    """What the compiler says against the modules."""
    deno = shutil.which("deno", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if deno is None:
        pytest.skip("the page's modules are checked by deno (extra dev)")
    command = [deno, "check", "--no-remote", "--quiet", "--config", str(config), *map(str, modules)]
    quiet = {**os.environ, "DENO_DIR": str(cache), "DENO_NO_UPDATE_CHECK": "1", "NO_COLOR": "1"}
    done = subprocess.run(command, env=quiet, stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8")
    assert done.returncode == 0 or "[ERROR]" in done.stderr, done.stderr
    return done.stderr


def test_the_types_of_what_is_said_are_those_of_the_process() -> None:
    written = WRITTEN.read_text(encoding="utf-8")
    assert written == message_types(), "run, in tests/: python -m support.pages.message_types"


def test_the_types_of_all_modules_hold(cache: Path) -> None:
    modules = sorted((ROOT / "client").rglob("*.js"))
    assert len(modules) > 30
    assert complaints(CONFIG, *modules, cache=cache) == ""


MISTAKES = [
    ("viewport.js", 'case "trouble":', 'case "scene":', "not assignable to type 'never'"),
    ("viewport.js", '{ type: "undo" }', '{ type: "undone" }', "not assignable to type"),
    ("viewport.js", '{ type: "center", x, y }', '{ type: "center", x }', "not assignable to parameter"),
    ("marks.js", "picture.view.zoom", "picture.zoom", "Property 'zoom' does not exist on type 'PictureHeader'"),
]


def test_a_message_that_is_forgotten_or_misread_is_found(tmp_path: Path, cache: Path) -> None:
    """Each in a copy of its own, and all by one run of the compiler, which takes seconds to begin."""
    shutil.copy(CONFIG, tmp_path)
    changed = []
    for n, (module, there, instead, _) in enumerate(MISTAKES):
        shutil.copytree(VIEWPORT, tmp_path / str(n))
        changed.append(tmp_path / str(n) / module)
        text = changed[-1].read_text(encoding="utf-8")
        assert there in text
        changed[-1].write_text(text.replace(there, instead), encoding="utf-8")
    errors = complaints(tmp_path / CONFIG.name, *changed, cache=cache).split("\n\n")
    for path, (*_, complaint) in zip(changed, MISTAKES, strict=True):
        assert any(complaint in error and path.as_uri() in error for error in errors), (path, errors)
