"""What IPython, and so a notebook, shows of an error: the caller's lines and the message, none of the libraries'."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.patience import PATIENCE

DIRECT = """
import volsplat as vs

def draw(name):
    return vs.render(name)

draw("nowhere.nrrd")
"""
POOLED = """
from concurrent.futures import ThreadPoolExecutor
import volsplat as vs

def draw(name):
    return vs.render(name)

list(ThreadPoolExecutor(1).map(draw, ["nowhere.nrrd"]))
"""
INTERNAL = """
from volsplat.protocol.wire.framing import Decoder

Decoder().advance(16)
"""


def shown(folder: Path, cells: str) -> str:
    (folder / "cells.py").write_text(cells, encoding="utf-8")
    asked = [sys.executable, "-m", "IPython", "--no-banner", "--colors=NoColor", str(folder / "cells.py")]
    env = {**os.environ, "IPYTHONDIR": str(folder)}
    ran = subprocess.run(asked, cwd=folder, env=env, capture_output=True, text=True, timeout=PATIENCE)
    return ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ("cells", "last", "call"),
    [(DIRECT, 7, 'draw("nowhere.nrrd")'), (POOLED, 8, 'list(ThreadPoolExecutor(1).map(draw, ["nowhere.nrrd"]))')],
    ids=["direct", "in a pool"],
)
def test_the_callers_lines_and_the_message_are_shown_alone(cells: str, last: int, call: str, tmp_path: Path) -> None:
    place = f'  File "{tmp_path}/cells.py", line'
    assert shown(tmp_path, cells) == (
        f"{place} {last}, in <module>\n    {call}\n{place} {last - 2}, in draw\n    return vs.render(name)\n"
        f"BadInput: {tmp_path}/nowhere.nrrd: there is no such file; check the path\n"
    )


def test_what_is_no_persons_mistake_keeps_its_traceback(tmp_path: Path) -> None:
    assert "framing.py" in shown(tmp_path, INTERNAL)
