"""`volsplat prepare --cluster`: the same bytes by a real Dask's workers, whichever are lost or late meanwhile."""

import json
import signal
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest

from support.engines.dask import DaskCluster, dask_cluster
from support.files.prepared import LITTLE, Told, killed_after, prepare_small, tree, values_of, written
from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file
from support.programs.programs import Person
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.machines import check_process
from volsplat.mapshade_server.prepare.run_mark import RunMark
from volsplat.program.task_pool import TaskPool
from volsplat.protocol.text.errors import BadInput

pytest.importorskip("distributed", reason="batch work needs distributed (extra dask)")

from volsplat.deploy.batch import task_run  # noqa: E402
from volsplat.deploy.batch.task_pools import opened_pool  # noqa: E402

SERVERS = "map-shade-servers = 1\nsplat-servers = 1\n"


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """With one worker, which no test loses."""
    with dask_cluster(tmp_path_factory.mktemp("dask")) as made:
        made.worker("--name", "first")
        yield made


@pytest.fixture
def second(engine: DaskCluster) -> Iterator[psutil.Process]:
    worker = engine.worker()
    yield worker
    worker.kill()


@pytest.fixture
def cluster(engine: DaskCluster, tmp_path: Path) -> Path:
    where = f'launcher = "dask"\ndask.scheduler-file = "{engine.scheduler_file}"\n'
    return cluster_file(tmp_path, "batch", where + SERVERS)


@pytest.fixture
def pool(cluster: Path) -> Iterator[TaskPool]:
    with opened_pool(cluster, lambda line: None) as made:
        yield made


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("volumes") / "volume.nrrd", values_of("int16"))


@pytest.fixture(scope="module")
def alone(volume: Path) -> dict[str, str]:
    """What a single process makes of it."""
    prepare_small(volume, volume.with_suffix(".zarr"))
    return tree(volume.with_suffix(".zarr"))


class Disturbed(Told):
    """Calls something once, when a few blocks of level 0 are packed."""

    def __init__(self, disturb: Callable[[], None]) -> None:
        super().__init__()
        self._disturb = disturb
        self._left = 3

    def advance(self, done: int) -> None:
        super().advance(done)
        self._left -= "packing" in self.stages and done > 0
        if self._left == 0:
            self._left = -1
            self._disturb()


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_many_machines_make_the_same_bytes_though_one_is_lost_or_frozen(
    end: signal.Signals,
    volume: Path,
    alone: dict[str, str],
    tmp_path: Path,
    pool: TaskPool,
    second: psutil.Process,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(task_run, "LATE_SECONDS", 0.5)
    told, out = Disturbed(lambda: second.send_signal(end)), tmp_path / "shared.zarr"
    prepare(str(volume), out, LITTLE, told, pool)
    assert tree(out) == alone
    assert list(told.stages) == ["surveying", "counting", "packing", "checking"]
    assert all(promised == done > 0 for promised, done in told.stages.values())


def test_a_run_that_was_ended_goes_on_with_machines_and_without(
    volume: Path, alone: dict[str, str], tmp_path: Path, pool: TaskPool
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    one, other = tmp_path / "one.zarr", tmp_path / "other.zarr"
    killed_after(22, volume, one)
    with pytest.raises(KeyboardInterrupt):
        prepare(str(volume), other, LITTLE, Disturbed(interrupt), pool)
    assert [path.name for path in (other / ".prepare").glob("run-*")] == []
    for out, by in ((one, pool), (other, None)):
        told = Told()
        prepare(str(volume), out, LITTLE, told, by)
        assert told.notes and told.notes[0].startswith("resuming: ")
        assert tree(out) == alone


def test_the_command_is_ended_by_ctrl_c_and_goes_on(tmp_path: Path, cluster: Path) -> None:
    person = Person(tmp_path)
    volume = written(tmp_path / "tall.nrrd", values_of("uint8", (64, 64, 700)))
    out = tmp_path / "tall.zarr"
    journal = out / ".prepare" / "journal.json"
    running = person.starts("prepare", "tall.nrrd", "tall.zarr", "--cluster", "cluster.toml")
    wait_until(lambda: journal.exists() and json.loads(journal.read_bytes())["shards"], "begun")
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=PATIENCE)
    assert running.returncode == 130
    assert said.split("\n") == ["stopped; the same command goes on from here", "", "volsplat: interrupted", ""]
    again = person.runs("prepare", "tall.nrrd", "tall.zarr", "--cluster", "cluster.toml")
    assert again.returncode == 0 and again.stderr.startswith("resuming: "), again.stderr
    prepare(str(volume), tmp_path / "alone.zarr", Options(), Told())
    assert tree(out) == tree(tmp_path / "alone.zarr")


def test_a_worker_that_shares_no_disk_is_named_before_anything_is_done(pool: TaskPool, tmp_path: Path) -> None:
    task = partial(check_process, RunMark(tmp_path / "elsewhere"), None)
    with pytest.raises(BadInput, match=r"Dask's worker first: .*elsewhere.* is not there; put OUT.zarr where all"):
        pool.on_each(task, lambda: None)


def test_a_worker_with_another_volsplat_is_named(
    engine: DaskCluster, cluster: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "volsplat-99.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: volsplat\nVersion: 99\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    before = engine.said.count("Registered to")
    worker = engine.worker()
    wait_until(lambda: engine.said.count("Registered to") > before, "there")
    with pytest.raises(BadInput, match="has volsplat 99, and this is .*; install the same on both"):
        with opened_pool(cluster, lambda line: None):
            pass
    worker.kill()


@pytest.mark.parametrize(
    ("machines", "said"),
    [
        ('launcher = "local"\n', 'only machines with launcher = "dask" share this work, and it has local'),
        ('launcher = "dask"\ndask.scheduler-file = "nowhere.json"\n', "nowhere.json: no such file"),
        (
            f'launcher = "dask"\ndask.scheduler = "tcp://a:1"\n{SERVERS}[[machines]]\nlauncher = "dask"\n',
            "its dask machines differ in scheduler or resources",
        ),
    ],
)
def test_a_cluster_that_cannot_do_it_is_one_line(volume: Path, tmp_path: Path, machines: str, said: str) -> None:
    cluster_file(tmp_path, "other", machines + SERVERS)
    done = Person(tmp_path).runs("prepare", volume.name, "o.zarr", "--cluster", "cluster.toml")
    assert done.returncode == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert not (tmp_path / "o.zarr").exists()
