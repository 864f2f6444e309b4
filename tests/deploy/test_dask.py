"""A cluster whose servers are tasks of a real Dask: placed, moved if a worker is lost, and the same picture as here."""

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest

from support.engines.dask import DaskCluster, dask_cluster
from support.patience import wait_until
from support.programs.clusters import cluster_file, drawn
from support.programs.programs import Person
from support.programs.server_processes import words_of
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.protocol.text.errors import BadInput

distributed = pytest.importorskip("distributed", reason="the launcher dask needs distributed (extra dask)")

TWO = "map-shade-servers = 1\nsplat-servers = 1\nthreads = 1\n"


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """With one worker, which has room for one server."""
    with dask_cluster(tmp_path_factory.mktemp("dask")) as made:
        made.worker("--resources", "volsplat=1")
        yield made


@pytest.fixture
def person(engine: DaskCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 24, 24)))
    return Person(tmp_path)


@pytest.fixture
def cluster(engine: DaskCluster, person: Person) -> Iterator[Path]:
    where = f'launcher = "dask"\ndask.scheduler-file = "{engine.scheduler_file}"\ndata-root = "{person.folder}"\n'
    path = cluster_file(person.folder, f"dask-{os.getpid()}", where + TWO)
    try:
        yield path
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def status(person: Person, cluster: Path) -> str:
    return person.runs("deploy", "status", str(cluster)).stdout


def brought_up(person: Person, cluster: Path) -> None:
    up = person.runs("deploy", "up", str(cluster))
    assert up.returncode == 0, up.stderr


def servers_of(worker: psutil.Process) -> list[psutil.Process]:
    return [child for child in worker.children(recursive=True) if "_server" in " ".join(words_of(child))]


def command_lines() -> list[str]:
    """Of all that run."""
    return [" ".join(process.info["cmdline"] or ()) for process in psutil.process_iter(["cmdline"])]


def ended(processes: list[psutil.Process]) -> bool:
    return not any(lives(process) for process in processes)


def lives(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


def test_servers_outlive_clients_and_a_lost_worker_s_is_started_on_another(
    engine: DaskCluster, person: Person, cluster: Path
) -> None:
    alone = drawn(person, "--single")
    brought_up(person, cluster)
    wait_until(lambda: "queued" in status(person, cluster) and "running" in status(person, cluster), "half placed")
    first = engine.worker("--resources", "volsplat=1")
    for _ in range(2):
        assert drawn(person, "--cluster", str(cluster)) == alone
    (server,) = [psutil.Process(process.pid) for process in first.children() if process]
    tied = [server, *servers_of(first)]
    second = engine.worker("--resources", "volsplat=1")
    with Session("head.nrrd", cluster=cluster) as session:
        scene = session.default_scene()
        image = session.render(scene)
        first.kill()
        assert session.render(scene).equal(image)
        wait_until(lambda: servers_of(second), "started on the other worker")
    wait_until(lambda: ended(tied), "ended with their worker")
    down = person.runs("deploy", "down", str(cluster))
    assert down.returncode == 0, down.stderr
    wait_until(lambda: not servers_of(second), "ended")
    second.kill()


def test_a_frozen_worker_keeps_nobody_waiting_and_ends_its_server_when_it_goes_on(
    engine: DaskCluster, person: Person, cluster: Path
) -> None:
    worker = engine.worker()
    brought_up(person, cluster)
    wait_until(lambda: servers_of(worker), "placed")
    servers = servers_of(worker)
    worker.send_signal(signal.SIGSTOP)
    assert person.runs("deploy", "down", str(cluster)).returncode == 0
    worker.send_signal(signal.SIGCONT)
    wait_until(lambda: ended(servers), "ended")
    worker.kill()


def test_the_token_is_in_no_log_and_on_no_command_line(engine: DaskCluster, person: Person, cluster: Path) -> None:
    brought_up(person, cluster)
    wait_until(lambda: "running" in status(person, cluster), "placed")
    (token_file,) = (person.folder / "state").rglob("token")
    token = token_file.read_text(encoding="utf-8").strip()
    assert token_file.stat().st_mode & 0o777 == 0o600
    wait_until(lambda: any("--name dask" in line for line in command_lines()), "started")
    assert not any(token in line for line in command_lines())

    def logged() -> str:
        return person.runs("deploy", "logs", str(cluster)).stdout

    wait_until(lambda: "no client at" in logged(), "told that no client is there")
    assert token not in logged() + engine.said


def test_a_server_that_cannot_run_is_ended_with_what_it_said(person: Person, cluster: Path) -> None:
    text = cluster.read_text(encoding="utf-8").replace(
        'launcher = "dask"', 'launcher = "dask"\ncommand = "/nowhere/volsplat"'
    )
    cluster.write_text(text)
    brought_up(person, cluster)
    wait_until(lambda: "ended" in status(person, cluster), "ended")
    assert "/nowhere/volsplat cannot be run" in person.runs("deploy", "logs", str(cluster)).stdout


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('dask.scheduler = "tcp://127.0.0.1:9"\n', "does not answer"),
        ('dask.scheduler-file = "nowhere.json"\n', "no such file"),
        ("", "needs dask.scheduler"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line(person: Person, keys: str, said: str) -> None:
    path = cluster_file(person.folder, "nobody", f'launcher = "dask"\nhost = "localhost"\n{keys}{TWO}')
    up = person.runs("deploy", "up", str(path))
    assert up.returncode == 2 and said in up.stderr and len(up.stderr.strip().splitlines()) <= 2, up.stderr


def test_tasks_of_which_one_cannot_be_given_are_all_taken_back(
    engine: DaskCluster, person: Person, cluster: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish, published = distributed.Client.publish_dataset, list[str]()

    async def once(client: Any, future: object, name: str) -> None:
        if published:
            raise OSError("the connection is lost")
        published.append(name)
        await publish(client, future, name=name)

    monkeypatch.setattr(distributed.Client, "publish_dataset", once)
    with pytest.raises(BadInput, match="does not answer: the connection is lost"):
        RunningCluster(cluster).up(print)
    with distributed.Client(scheduler_file=str(engine.scheduler_file), set_as_default=False) as client:
        assert len(published) == 1 and published[0] not in client.list_datasets()
