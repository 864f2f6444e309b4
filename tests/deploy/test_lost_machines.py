"""A cluster of which a machine is gone, or cannot be found: the others are brought up, told apart and brought down."""

import os
from pathlib import Path

import pytest

from support.patience import wait_until
from support.programs.clusters import cluster_file, sshd
from support.programs.programs import Person

BOTH_KINDS = 'launcher = "local"\nthreads = 1\nmap-shade-servers = 1\nsplat-servers = 1\n'


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return Person(tmp_path)


def test_a_machine_that_is_gone_for_good_keeps_nobody_from_the_others(person: Person, tmp_path: Path) -> None:
    """Its servers end by themselves after `keep`, and are forgotten then."""
    name = f"gone-{os.getpid()}"
    with sshd(tmp_path / "gone") as ssh:
        path = cluster_file(person.folder, name, BOTH_KINDS, f"{ssh}map-shade-servers = 1\n", keep=3)
        assert person.runs("deploy", "up", str(path)).returncode == 0
    down = person.runs("deploy", "down", str(path))
    assert down.returncode == 2 and "run it again when they answer, or in 3 s" in down.stderr, down.stderr
    cluster_file(person.folder, name, BOTH_KINDS, keep=3)
    changed = person.runs("deploy", "up", str(path))
    assert changed.returncode == 2 and "has changed since" in changed.stderr
    wait_until(lambda: person.runs("deploy", "down", str(path)).returncode == 0, "forgotten")
    assert person.runs("deploy", "up", str(path)).returncode == 0
    assert person.runs("deploy", "down", str(path)).returncode == 0
