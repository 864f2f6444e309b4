"""What IPython, and so a notebook, shows of an error: the caller's lines and the message, none of the library's own."""

import os
import subprocess
import sys
from pathlib import Path

from support.patience import PATIENCE

CELLS = """
import volsplat as vs

def draw(name):
    return vs.render(name)

draw("nowhere.nrrd")
"""
SHOWN = """  File "{cells}", line 7, in <module>
    draw("nowhere.nrrd")
  File "{cells}", line 5, in draw
    return vs.render(name)
BadInput: {folder}/nowhere.nrrd: there is no such file; check the path
"""


def test_ipython_shows_where_the_caller_stood_and_the_message_alone(tmp_path: Path) -> None:
    cells = tmp_path / "cells.py"
    cells.write_text(CELLS, encoding="utf-8")
    asked = [sys.executable, "-m", "IPython", "--no-banner", "--colors=NoColor", str(cells)]
    env = {**os.environ, "IPYTHONDIR": str(tmp_path)}
    ran = subprocess.run(asked, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=PATIENCE)
    assert ran.stdout + ran.stderr == SHOWN.format(cells=cells, folder=tmp_path)
