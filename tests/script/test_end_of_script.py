"""Scripts that come to their end while a thread of theirs draws."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support.patience import PATIENCE
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

DRAWING = """
import threading
import volsplat as vs

drawn = threading.Event()

def draw():
    while True:
        vs.render("head.nrrd", size=400)
        drawn.set()

threading.Thread(target=draw, daemon=True).start()
drawn.wait()
"""

DRAWING_ON = """
import threading
import volsplat as vs

def draw():
    threading.main_thread().join()
    with vs.open("head.nrrd", workers=1) as session:
        print(vs.render(session, size=16), session.render(session.default_scene().with_(size=16)).shape)

threading.Thread(target=draw).start()
"""


def test_a_thread_that_is_waited_for_draws_on_after_the_last_line(tmp_path: Path) -> None:
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", (24, 32, 28)))
    ended = subprocess.run(
        [sys.executable, "-c", DRAWING_ON], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.stderr == ""
    assert ended.stdout == "<volsplat image of 16 x 16 pixels> torch.Size([16, 16, 4])\n"


@pytest.mark.parametrize("run", range(4))
def test_a_thread_that_nobody_waits_for_does_not_hold_up_the_end(run: int, tmp_path: Path) -> None:
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", (24, 32, 28)))
    ended = subprocess.run(
        [sys.executable, "-c", DRAWING], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE
    )
    assert (ended.returncode, ended.stderr) == (0, "")
