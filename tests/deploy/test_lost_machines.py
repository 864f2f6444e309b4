"""A cluster of which a machine is gone, or cannot be found: the others are brought up, told apart and brought down."""

import os
from pathlib import Path

import pytest

from support.patience import wait_until
from support.programs.clusters import cluster_file, servers_of, sshd
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


def unknown(launcher: str) -> str:
    """A machine of this launcher whose servers cannot be told where to dial."""
    options = '\nhost = "127.0.0.1"\nssh = {options = ["-o", "NoSuchOption=1"]}' if launcher == "ssh" else ""
    return f'launcher = "{launcher}"\nmap-shade-servers = 1{options}\n'


@pytest.mark.parametrize("launcher", ["ssh", "slurm", "manual"])
def test_a_machine_that_cannot_be_looked_up_is_one_that_could_not_be_started(
    person: Person, launcher: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scontrol = tmp_path / "bin" / "scontrol"  # of a Slurm that says no more at once
    scontrol.parent.mkdir()
    scontrol.write_text("#!/bin/sh\necho there is no controller >&2\nexit 1\n", encoding="utf-8")
    scontrol.chmod(0o755)
    monkeypatch.setenv("PATH", f"{scontrol.parent}:{os.environ['PATH']}")
    path = str(cluster_file(person.folder, f"unknown-{os.getpid()}", unknown(launcher), BOTH_KINDS))
    try:
        up = person.runs("deploy", "up", path)
        assert up.returncode == 2 and len(servers_of(person)) == 2, up.stderr
        status = person.runs("deploy", "status", path)
        assert status.returncode == 1 and "1 of 1 servers could not be started" in status.stderr
        assert person.runs("deploy", "up", path).returncode == 2
    finally:
        assert person.runs("deploy", "down", path).returncode == 0
