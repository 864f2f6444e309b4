"""What a type checker tells of a script that calls us."""

import re
import subprocess
import sys
from pathlib import Path

REPO = Path(__file__).resolve().parents[2]
SCRIPT = """
import volsplat as vs
import volsplat.client as client

reveal_type(vs.render("head.nrrd", size=200))
reveal_type(vs.render("head.nrrd", "ct-bone", vs.Step.F, vs.Figure()))
reveal_type(vs.render("head.nrrd", figure=vs.Figure()))
with vs.open("head.nrrd") as session:
    reveal_type(session.default_scene())
vs.rendr("head.nrrd")
client.Sesion
"""


def test_a_script_is_told_of_what_it_gets_and_of_names_that_there_are_not(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    # With the checkout's settings it finds what was checked before.
    checked = subprocess.run([sys.executable, "-m", "mypy", script], capture_output=True, text=True, cwd=REPO)
    told = re.findall(r'is "([\w.]+)"', checked.stdout)
    assert [one.rpartition(".")[2] for one in told] == ["RenderedImage", "RenderedFigure", "RenderedFigure", "Scene"]
    assert re.findall(r'(?:no|has no) attribute "(\w+)"', checked.stdout) == ["rendr", "Sesion"], checked.stdout
