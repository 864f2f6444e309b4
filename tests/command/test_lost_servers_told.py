"""A command whose output nobody watches says how servers join, and which of them it went on without."""

import shlex
import socket
from contextlib import closing
from pathlib import Path

import pytest

from support.patience import PATIENCE, wait_until
from support.programs.programs import Person
from support.programs.server_processes import is_server
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

IMAGES = 120
WITHOUT_IPV6 = not socket.has_dualstack_ipv6()


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


@pytest.mark.parametrize(
    ("host", "everywhere"),
    [
        ("0.0.0.0", "0.0.0.0:0"),
        pytest.param("[::]", "[::]:0", marks=pytest.mark.skipif(WITHOUT_IPV6, reason="this machine has no IPv6")),
    ],
)
def test_the_commands_it_prints_are_for_the_kind_of_address_it_listens_at(
    tmp_path: Path, host: str, everywhere: str
) -> None:
    person = Person(tmp_path)
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 24, 24)))
    drawing = ("render", "shells.nrrd", "-o", "shells.png", "--size", "64", "--workers", "1", "--listen", f"{host}:0")
    with closing(person.begins(*drawing)) as command:
        told = next(line for line in command.stderr if "volsplat splat-server --connect" in line)
    words = shlex.split(told)
    assert words[words.index("--listen") + 1] == everywhere
    assert "[" not in everywhere or f"'{everywhere}'" in told, "zsh would look for files"
