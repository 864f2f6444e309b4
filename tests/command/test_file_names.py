"""Names of bytes that are not UTF-8, as old disks have them: refused in one line, and no harm beside or above."""

import os
import subprocess
from pathlib import Path

import pytest

from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT, Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

LATIN = os.fsdecode(b"b\xfcd")
COMMANDS = {
    "render": ["render", f"{LATIN}.nrrd", "-o", "head.png"],
    "render --single": ["render", f"{LATIN}.nrrd", "-o", "head.png", "--single"],
    "image": ["render", "head.nrrd", "-o", f"{LATIN}.png"],
    "movie": ["movie", "head.nrrd", "-o", LATIN, "--frames", "2"],
    "movie in a folder of such a name": ["movie", "head.nrrd", "-o", f"{LATIN}/frames", "--frames", "2"],
    "steps": ["render", "head.nrrd", "--steps-dir", LATIN],
    "scene from an image": ["scene", f"{LATIN}.png"],
    "export": ["export", f"{LATIN}.nrrd", "-o", "head.ply"],
    "prepare": ["prepare", f"{LATIN}.nrrd", "head.zarr"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two names of one volume, of an image that nobody reads so far, and a folder with the volume."""
    folder = tmp_path_factory.mktemp("names")
    write_volume(folder / "head.nrrd", *make_phantom("head", size=(16, 20, 18)))
    (folder / LATIN).mkdir()
    for link in (f"{LATIN}.nrrd", f"{LATIN}/head.nrrd"):
        os.link(folder / "head.nrrd", folder / link)
    (folder / f"{LATIN}.png").write_bytes(b"\x89PNG")
    return folder


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_a_name_that_is_not_utf8_is_refused_in_one_line(folder: Path, words: list[str]) -> None:
    before = sorted(os.listdir(os.fsencode(folder)))
    done = Person(folder).runs(*words)
    assert done.returncode == 2, done.stderr
    assert "this name is not UTF-8; rename it, or link to it by another name" in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(os.listdir(os.fsencode(folder))) == before


OUTPUTS = {
    "image": ["render", "head.nrrd", "--single", "-o", "{}/head.png"],
    "steps": ["render", "head.nrrd", "--single", "--steps-dir", "{}/steps"],
    "movie": ["movie", "head.nrrd", "--single", "--frames", "2", "--size", "16x16", "-o", "{}/frames"],
    "store": ["prepare", "head.nrrd", "{}/head.zarr"],
    "phantom": ["phantom", "ramp", "--size", "4", "-o", "{}/ramp.nrrd"],
}


@pytest.mark.parametrize("words", OUTPUTS.values(), ids=OUTPUTS)
def test_what_is_written_may_be_named_by_a_url_of_a_file_here_and_by_no_other(
    folder: Path, tmp_path: Path, words: list[str]
) -> None:
    before = sorted(os.listdir(os.fsencode(folder)))
    for url, why in (
        (f"file://otherhost{tmp_path}", "names the machine otherhost, and file:// reaches files of this one alone"),
        (f"FILE://otherhost{tmp_path}", "names the machine otherhost, and file:// reaches files of this one alone"),
        ("S3://bucket", "is a URL, and what is meant must be a file or folder here; give its path"),
    ):
        refused = Person(folder).runs(*(word.format(url) for word in words))
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1) and why in refused.stderr
        assert not list(tmp_path.iterdir())
    for url, place in ((f"file://{tmp_path}/a%20folder", "a folder"), (f"FILE://LocalHost{tmp_path}/b", "b")):
        (tmp_path / place).mkdir()
        done = Person(folder).runs(*(word.format(url) for word in words))
        assert done.returncode == 0, done.stderr
        assert list((tmp_path / place).iterdir())
    assert sorted(os.listdir(os.fsencode(folder))) == before


def test_where_the_language_setting_is_at_fault_the_name_is_not_blamed(folder: Path) -> None:
    plain = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [VOLSPLAT, "info", "dir é/ü.nrrd".encode()],
        cwd=folder,
        env={**Person(folder).environment, **plain},
        capture_output=True,
        timeout=PATIENCE,
    )
    assert done.returncode == 2 and done.stderr.count(b"\n") == 1, done.stderr
    assert b"set LC_ALL=C.UTF-8" in done.stderr and b"rename" not in done.stderr


def test_such_a_folder_is_worked_in_by_a_link_to_it(folder: Path) -> None:
    (folder / "link").symlink_to(LATIN)
    done = Person(folder).runs("render", "link/head.nrrd", "-o", "link/head.tif", "--size", "32")
    assert done.returncode == 0, done.stderr
    assert (folder / LATIN / "head.tif").is_file()


def test_servers_start_whatever_bytes_the_environment_holds(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PWD", str(folder / LATIN))
    done = Person(folder).runs("render", "head.nrrd", "-o", "head.png", "--size", "32")
    assert done.returncode == 0, done.stderr
