"""Files that are not whole yet: whoever is killed meanwhile leaves them for the next program to sweep."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from volsplat.bench.tables.record import write_text
from volsplat.client.image.image_formats import check_place
from volsplat.program.temporary_folder import made_folder, temporary_folder
from volsplat.program.temporary_name import temporary_name
from volsplat.protocol.text.errors import BadInput

LEAVES = """
import sys
from pathlib import Path
from volsplat.program.temporary_name import temporary_name
name = temporary_name(Path(sys.argv[1]))
if name.suffix:
    name.write_bytes(b"half")
else:
    name.mkdir()
    (name / "0001.png").write_bytes(b"half")
print("left", flush=True)
sys.stdin.read()
"""


LEAVES_FOLDER = """
import sys
from volsplat.program.temporary_folder import made_folder
(made_folder() / "head.nrrd").write_bytes(b"a volume")
print("left", flush=True)
sys.stdin.read()
"""


def test_what_a_link_leads_to_is_written_and_the_link_stays_one(tmp_path: Path) -> None:
    link = tmp_path / "link.json"
    link.symlink_to("whole.json")
    for text in ("one", "two"):
        check_place(link)
        write_text(link, text)
        assert link.is_symlink() and (tmp_path / "whole.json").read_text(encoding="utf-8") == text


def test_a_link_into_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "link.json").symlink_to("absent/whole.json")
    with pytest.raises(BadInput, match=f"there is no folder {tmp_path}/absent; make it first"):
        check_place(tmp_path / "link.json")


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


def leaves_folder() -> None:
    """A program that is killed while it needs a folder."""
    command = [sys.executable, "-c", LEAVES_FOLDER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None and program.stdout.readline() == b"left\n"
        program.kill()


def test_a_temporary_folder_that_a_killed_program_left_is_swept_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    leaves_folder()
    (left,) = tmp_path.iterdir()
    with temporary_folder() as folder:
        assert list(tmp_path.iterdir()) == [folder] != [left] and list(folder.iterdir()) == []
        (folder / "head.nrrd").touch()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder to another user")
def test_a_temporary_folder_of_another_user_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    leaves_folder()
    (left,) = tmp_path.iterdir()
    os.chown(left, 65534, 65534)
    assert {made_folder(), left} == set(tmp_path.iterdir())
