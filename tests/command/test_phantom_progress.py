"""`volsplat phantom` on a terminal: a bar while it makes the volume, and none elsewhere."""

import os
import pty
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from support.patience import PATIENCE

VOLSPLAT = str(Path(sys.executable).with_name("volsplat"))


def read_all(terminal: int) -> str:
    """What was written to the other end, which is closed by now."""
    said = b""
    with suppress(OSError):  # the end of a terminal's output
        while data := os.read(terminal, 1 << 16):
            said += data
    return said.decode()


@pytest.mark.parametrize("extension", [".nrrd", ".mha"])
def test_sheets_are_counted_on_a_terminal(tmp_path: Path, extension: str) -> None:
    terminal, program = pty.openpty()
    command = [VOLSPLAT, "phantom", "shells", "--size", "8x9x10", "-o", str(tmp_path / f"shells{extension}")]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    subprocess.run(command, check=True, stderr=program, env=environment, timeout=PATIENCE)
    os.close(program)
    said = read_all(terminal)
    os.close(terminal)
    assert "making sheets" in said and "10/10" in said and "8 x 9 x 10 voxels" in said


def test_elsewhere_there_is_one_line(tmp_path: Path) -> None:
    command = [VOLSPLAT, "phantom", "shells", "--size", "8", "-o", str(tmp_path / "shells.nrrd")]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stderr.count("\n") == 1 and "8 x 8 x 8 voxels" in done.stderr


def test_what_fills_disks_says_so_first(tmp_path: Path) -> None:
    command = [VOLSPLAT, "phantom", "seismic", "--size", "32x32768x1024", "-o", str(tmp_path / "seismic.nrrd")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as making:
        assert making.stderr is not None
        try:
            assert making.stderr.readline() == "makes 4.29 GB of voxels, which takes long; Ctrl-C ends it\n"
        finally:
            making.kill()
