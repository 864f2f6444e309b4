"""A cluster of which a machine is gone, or cannot be found: the others are brought up, told apart and brought down."""

import os
import time
from pathlib import Path

import msgspec
import psutil
import pytest

from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file, servers_of, sshd
from support.programs.programs import Person
from volsplat.deploy.cluster.lasting_clock import Moment
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.protocol.text.errors import BadInput

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


def test_a_clock_that_leaps_makes_no_server_end_sooner(
    person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does a machine that is started anew, whose clock begins again."""
    keep = 1000
    with sshd(tmp_path / "gone") as ssh:
        path = cluster_file(
            person.folder, f"leaps-{os.getpid()}", BOTH_KINDS, f"{ssh}map-shade-servers = 1\n", keep=keep
        )
        assert person.runs("deploy", "up", str(path)).returncode == 0
    cluster = RunningCluster(path)
    try:
        with pytest.raises(BadInput, match="not everything is down"):
            cluster.down(print)
        monkeypatch.setattr(time, "time", lambda: time.time_ns() / 1e9 + 100 * keep)
        with pytest.raises(BadInput, match="not everything is down"):
            cluster.down(print)
        state = cluster.folder.load()
        assert state is not None
        before = dict.fromkeys(state.unanswered_since, Moment("another", -keep))
        cluster.folder.save(msgspec.structs.replace(state, unanswered_since=before))
        with pytest.raises(BadInput, match=f"in {keep} s"):
            cluster.down(print)
    finally:
        psutil.Process(left_by(path, "127.0.0.1 map/shade")).kill()


def test_only_time_of_one_run_of_the_machine_has_passed_for_certain() -> None:
    earlier, later = Moment("a", 5.0), Moment("a", 7.0)
    assert earlier.until(later) == 2.0 and later.until(earlier) == 0.0
    assert earlier.until(Moment("b", 7.0)) == 0.0
    assert 0.0 <= Moment.now().until(Moment.now()) < PATIENCE


def test_jobs_that_may_wait_still_are_named_with_the_command_that_ends_them(
    person: Person, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A job that Slurm begins after `keep` has passed ends by itself only later."""
    commands = tmp_path / "bin"  # of a Slurm that takes jobs, and then says no more
    commands.mkdir()
    says = {"sbatch": "echo 4711", "scontrol": "echo 'SlurmctldHost[0] = here(127.0.0.1)'", "squeue": "exit 1"}
    for command, line in says.items():
        (commands / command).write_text(f"#!/bin/sh\n{line}\n", encoding="utf-8")
        (commands / command).chmod(0o755)
    monkeypatch.setenv("PATH", f"{commands}:{os.environ['PATH']}")
    machine = f'launcher = "slurm"\nslurm.folder = "{tmp_path / "jobs"}"\nmap-shade-servers = 1\nsplat-servers = 1\n'
    path = cluster_file(person.folder, f"queued-{os.getpid()}", machine, keep=1)
    person.runs("deploy", "up", str(path))
    downs = list[str]()

    def is_forgotten() -> bool:
        ran = person.runs("deploy", "down", str(path))
        downs.append(ran.stdout + ran.stderr)
        return ran.returncode == 0

    wait_until(is_forgotten, "forgotten")
    for said in downs:  # before `keep` has passed, and after
        assert "that slurm has not begun yet; end these by: scancel 4711 4711" in " ".join(said.split()), downs


def test_servers_that_nobody_has_heard_of_are_not_said_to_be_up(person: Person, tmp_path: Path) -> None:
    with sshd(tmp_path / "gone") as ssh:
        machines = BOTH_KINDS, f"{ssh}map-shade-servers = 1\n", unknown("ssh")
        path = cluster_file(person.folder, f"heard-{os.getpid()}", *machines, keep=3)
        first = person.runs("deploy", "up", str(path))
        assert f"; the other 3 servers are up, and used by --cluster {path}" in first.stderr, first.stderr
    second = person.runs("deploy", "up", str(path))
    assert f"; the other 2 servers are up, and used by --cluster {path}" in second.stderr, second.stderr
    person.runs("deploy", "down", str(path))  # ends those that can be reached; the others end by themselves


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


def test_servers_that_another_command_has_ended_are_not_started_anew(person: Person) -> None:
    """By a client that draws with them, nor in another command's cluster of the same file."""
    path = cluster_file(person.folder, f"ended-{os.getpid()}", BOTH_KINDS)
    drawing = RunningCluster(path)
    state = drawing.up(print)
    name = state.servers[0].started.name
    RunningCluster(path).down(print)
    with pytest.raises(BadInput, match="another command has brought it down"):
        drawing.up_anew(state, [name], print)
    assert drawing.state() is None and not servers_of(person)
    another = RunningCluster(path).up(print)
    try:
        with pytest.raises(BadInput, match="another command has brought it down"):
            drawing.up_anew(state, [name], print)
        assert drawing.state() == another
        drawing.folder.save(
            msgspec.structs.replace(another, unanswered_since={0: Moment.now()})
        )  # a `down` that did not do
        with pytest.raises(BadInput, match="another command has brought it down"):
            drawing.up_anew(another, [name], print)
        drawing.folder.save(another)
        anew = drawing.up_anew(another, [name], print)
        assert [one.started.name for one in anew.servers] == [one.started.name for one in another.servers]
        kept = [before == now for before, now in zip(another.servers, anew.servers, strict=True)]
        assert kept == [False, True]
    finally:
        RunningCluster(path).down(print)


def left_by(cluster: Path, server: str) -> int:
    """The process of this server."""
    state = RunningCluster(cluster).state()
    assert state is not None
    return next(int(one.started.handle["process"]) for one in state.servers if one.started.name == server)


def test_a_machine_that_does_not_answer_is_not_said_to_be_up(person: Person, tmp_path: Path) -> None:
    with sshd(tmp_path / "silent") as ssh:
        by_hand = 'launcher = "manual"\nmap-shade-servers = 1\nlisten = "127.0.0.1:1"\n'
        machines = (BOTH_KINDS, f"{ssh}map-shade-servers = 1\n", by_hand)
        path = cluster_file(person.folder, f"silent-{os.getpid()}", *machines)
        up = person.runs("deploy", "up", str(path))
        assert up.returncode == 0 and ": 3 of 4 servers are up; manual: cannot be asked; use them" in up.stderr
        assert person.runs("deploy", "status", str(path)).returncode == 0, "nobody asks after those started by hand"
    try:
        up = person.runs("deploy", "up", str(path))
        assert up.returncode == 1 and ": 2 of 4 servers are up; 127.0.0.1: unknown: ssh: connect" in up.stderr, (
            up.stderr
        )
        status = person.runs("deploy", "status", str(path))
        assert status.returncode == 1 and status.stdout.count("unknown") == 2, status.stdout
    finally:
        psutil.Process(left_by(path, "127.0.0.1 map/shade")).kill()
        person.runs("deploy", "down", str(path))
