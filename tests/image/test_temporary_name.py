"""Files that are not whole yet: whoever is killed meanwhile leaves them for the next program to sweep."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from volsplat.client.image.temporary_name import temporary_name

LEAVES = """
import sys
from pathlib import Path
from volsplat.client.image.temporary_name import temporary_name
name = temporary_name(Path(sys.argv[1]))
if name.suffix:
    name.write_bytes(b"half")
else:
    name.mkdir()
    (name / "0001.png").write_bytes(b"half")
print("left", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("name", ["head.png", "frames"])
def test_what_a_killed_program_left_is_swept_and_what_a_running_one_writes_is_not(tmp_path: Path, name: str) -> None:
    (tmp_path / ".volsplat-strange-1-0f.png").write_bytes(b"of another machine")
    before = set(tmp_path.iterdir())
    writer = subprocess.Popen(
        [sys.executable, "-c", LEAVES, str(tmp_path / name)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"left\n"
        (left,) = set(tmp_path.iterdir()) - before
        temporary_name(tmp_path / "other.png")
        assert left.exists(), "it is being written"
        writer.kill()
        writer.wait()
    mine = temporary_name(tmp_path / "other.png")
    assert set(tmp_path.iterdir()) == before and str(os.getpid()) in mine.name
    assert temporary_name(tmp_path / "absent" / "other.png").suffix == ".png"
