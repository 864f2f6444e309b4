"""A command whose output nobody watches says which servers it went on without, and draws what it was asked for."""

from contextlib import closing
from pathlib import Path

from support.patience import PATIENCE, wait_until
from support.programs.programs import Person
from support.programs.server_processes import is_server
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

IMAGES = 120


def test_a_movie_says_in_a_line_that_a_server_was_lost(tmp_path: Path) -> None:
    person = Person(tmp_path)
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 24, 24)))
    turns = ("movie", "shells.nrrd", "-o", "turns", "--frames", str(IMAGES), "--size", "64", "--workers", "2")
    with closing(person.begins(*turns)) as command:
        wait_until((tmp_path / "turns").exists, "is the first image there")
        next(one for one in person.servers() if is_server(one, "mapshade_server")).kill()
        assert command.wait(PATIENCE) == 0
        told = [line for line in command.stderr if line.startswith("note: map/shade server")]
    assert len(told) == 1
    assert "killed by SIGKILL" in told[0] and "; others take over i 0-" in told[0]
    assert len(list((tmp_path / "turns").iterdir())) == IMAGES
