"""A cluster whose servers are jobs of a real Slurm: queued, placed, cancelled, and the same picture as drawn here."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.engines.slurm import CORES, slurm, why_no_slurm
from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file, drawn, handles
from support.programs.programs import VOLSPLAT, Person
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session import cluster_watch

WHY_NOT = why_no_slurm()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

MACHINE = f'launcher = "slurm"\ncommand = "{VOLSPLAT}"\nthreads = 1\n'
FULL = f"slurm.options = ['--exclusive', '--cpus-per-task={CORES}']\n"  # one job fills the only node


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    with slurm(tmp_path_factory.mktemp("slurm")) as environment:
        yield environment


@pytest.fixture
def person(engine: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("SLURM_CONF", engine["SLURM_CONF"])
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 24, 24)))
    return Person(tmp_path)


@pytest.fixture
def cluster(person: Person) -> Iterator[Path]:
    yield from brought_down(person, MACHINE + "map-shade-servers = 1\nsplat-servers = 1\n")


@pytest.fixture
def too_large(person: Person) -> Iterator[Path]:
    """Its second server waits for the first to end."""
    yield from brought_down(person, MACHINE + FULL + "map-shade-servers = 1\nsplat-servers = 1\n")


def brought_down(person: Person, machine: str) -> Iterator[Path]:
    path = cluster_file(person.folder, f"slurm-{os.getpid()}", f'data-root = "{person.folder}"\n{machine}')
    try:
        yield path
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def asked(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True).stdout


def jobs_left() -> list[str]:
    return asked("squeue", "--noheader", "--format=%A").split()


def status(person: Person, cluster: Path) -> str:
    return person.runs("deploy", "status", str(cluster)).stdout


def test_jobs_serve_one_client_after_the_other_and_one_cancelled_is_given_anew(person: Person, cluster: Path) -> None:
    alone = drawn(person, "--single")
    up = person.runs("deploy", "up", str(cluster))
    assert up.returncode == 0, up.stderr
    for _ in range(2):
        assert drawn(person, "--cluster", str(cluster)) == alone
    assert status(person, cluster).count("running") == 2
    first = handles(person)
    asked("scancel", first[1]["job"])
    wait_until(lambda: "ended" in status(person, cluster), "noticed")
    assert drawn(person, "--cluster", str(cluster)) == alone
    second = handles(person)
    assert second[0] == first[0] and second[1] != first[1]
    assert person.runs("deploy", "down", str(cluster)).returncode == 0
    wait_until(lambda: not jobs_left(), "without jobs")


def test_who_waits_is_queued_with_slurm_s_reason_and_is_cancelled_there(person: Person, too_large: Path) -> None:
    assert person.runs("deploy", "up", str(too_large)).returncode == 0
    wait_until(lambda: "running" in (said := status(person, too_large)) and "Resources" in said, "queued")
    assert "queued" in status(person, too_large)
    assert person.runs("deploy", "down", str(too_large)).returncode == 0
    wait_until(lambda: not jobs_left(), "without jobs")


def test_the_token_is_in_a_private_file_alone(person: Person, cluster: Path) -> None:
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    (token_file,) = (person.folder / "state").rglob("slurm/token")
    token = token_file.read_text(encoding="utf-8").strip()
    assert token_file.stat().st_mode & 0o777 == 0o600
    for handle in handles(person):
        told = asked("scontrol", "show", "job", "--details", handle["job"])
        assert token not in told + asked("scontrol", "write", "batch_script", handle["job"], "-")
    assert person.runs("deploy", "down", str(cluster)).returncode == 0
    assert not token_file.exists()


def test_a_job_that_cannot_run_is_ended_with_what_it_said(person: Person) -> None:
    machine = MACHINE.replace(str(VOLSPLAT), "/nowhere/volsplat") + "map-shade-servers = 1\nsplat-servers = 1\n"
    path = cluster_file(person.folder, "nowhere", machine)
    try:
        assert person.runs("deploy", "up", str(path)).returncode == 0
        wait_until(lambda: status(person, path).count("ended") == 2, "ended")
        assert "failed" in status(person, path)
        assert "/nowhere/volsplat: not found" in person.runs("deploy", "logs", str(path)).stdout
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def test_options_that_slurm_refuses_are_told_in_its_words_and_leave_no_job(person: Person) -> None:
    machine = MACHINE + 'slurm.options = ["--partition=none"]\nmap-shade-servers = 1\nsplat-servers = 1\n'
    up = person.runs("deploy", "up", str(cluster_file(person.folder, "refused", machine)))
    assert up.returncode == 2 and "invalid partition" in up.stderr and not jobs_left()


def test_servers_that_dial_in_are_known_by_their_names(
    person: Person, cluster: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert person.runs("deploy", "up", str(cluster)).returncode == 0
    with Session(person.folder / "head.nrrd", cluster=cluster) as session:
        scene = session.default_scene()  # all have joined
        monkeypatch.setattr(cluster_watch, "LOOK_SECONDS", 0.05)
        looked, answers = cluster_watch.ClusterWatch._missing, list[list[str]]()

        def noted(self: cluster_watch.ClusterWatch) -> list[str]:
            answers.append(looked(self))
            return answers[-1]

        monkeypatch.setattr(cluster_watch.ClusterWatch, "_missing", noted)
        wait_until(lambda: len(answers) > 1, "looked after")
        assert not any(answers)
        session.finish(scene)
