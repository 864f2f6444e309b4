"""A cluster measured with more and more of its servers: real ones, brought up for their row and down after it."""

import signal
from pathlib import Path

import pytest

from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file, servers_of
from support.programs.programs import Person
from volsplat.bench.clusters.cluster_sizes import measured_cluster, narrowed, toml_of
from volsplat.bench.tables.record import read_record
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.deploy.cluster_file import Cluster, Machine, cluster_from_toml
from volsplat.deploy.launcher_keys import DaskKeys, SshKeys
from volsplat.protocol.rules.refinement import PAPER_STEPS

LOCAL = 'launcher = "local"\nthreads = 1\nmap-shade-servers = 2\nsplat-servers = 1\n'
LAB = Cluster(
    name="lab",
    machines=(
        Machine(launcher="local", splat_servers=1),
        Machine(launcher="ssh", host="n1", map_shade_servers=2, ssh=SshKeys(options=("-J", 'a "b" \\ ü'))),
        Machine(launcher="dask", map_shade_servers=1, threads=2, dask=DaskKeys(resources={"volsplat": 1.0})),
    ),
)


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", size=(24, 24, 24)))
    return Person(tmp_path)


@pytest.mark.parametrize("servers", [1, 2, 3])
def test_a_cluster_of_fewer_servers_is_a_cluster_file_of_its_own(servers: int) -> None:
    fewer = narrowed(LAB, servers)
    assert cluster_from_toml(toml_of(fewer), "fewer") == fewer
    assert fewer.map_shade_servers == servers and fewer.splat_servers == 1
    assert len(fewer.machines) == (3 if servers == 3 else 2) and fewer.name != LAB.name


def test_machines_are_added_one_by_one(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text(toml_of(LAB), encoding="utf-8")
    assert measured_cluster(path, None).sizes == [2, 3]
    path.write_text(toml_of(narrowed(LAB, 2)), encoding="utf-8")
    assert measured_cluster(path, None).sizes == [1, 2], "of one machine alone its servers are"


@pytest.mark.parametrize("command", ["paper", "scaling"])
def test_each_size_of_a_cluster_is_a_row_with_its_links_and_limits(person: Person, command: str) -> None:
    images = ("--size", "48x48") if command == "paper" else ("--images", "48", "--sizes", "1")
    files = ("--json", "found.json", "--markdown", "found.md")
    cluster = str(cluster_file(person.folder, "lab", LOCAL))
    done = person.runs("bench", command, "shells.nrrd", "--cluster", cluster, "--repeats", "2", *images, *files)
    assert done.returncode == 0, done.stderr
    found, markdown = (
        read_record(person.folder / "found.json"),
        (person.folder / "found.md").read_text(encoding="utf-8"),
    )
    assert "| 1989, 4 over 1 Sun-4 | 1 server | 2 servers |" in markdown and "| efficiency | 1.12 | 1.00 |" in markdown
    assert markdown.count(" | client | ") == 2 and markdown.count("| map/shade server ") == 3
    assert "what limits 2 servers" in found.facts
    if command == "paper":
        rows = ("1 thread", "1 server", "2 servers")
        assert {one.name for one in found.figures} == {f"{row}, step {step}" for row in rows for step in PAPER_STEPS}
    assert person.runs("deploy", "status", cluster).returncode == 2, "it is up"
    wait_until(lambda: not servers_of(person), "without servers")


@pytest.mark.parametrize("command", ["paper", "scaling"])
def test_ctrl_c_brings_it_down(person: Person, command: str) -> None:
    data = person.folder / "data"
    data.mkdir()
    (person.folder / "shells.nrrd").rename(data / "shells.nrrd")  # only the servers see it, which so come first
    cluster = str(cluster_file(person.folder, "lab", f'data-root = "{data}"\n{LOCAL}'))
    run = person.starts("bench", command, "shells.nrrd", "--cluster", cluster, "--repeats", "100000")
    wait_until(lambda: len(servers_of(person)) == 2, "with one map/shade server and a splat server")
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=PATIENCE)
    assert run.returncode == 130 and "Traceback" not in said, said
    assert not servers_of(person)


def test_a_cluster_that_is_up_is_not_measured(person: Person) -> None:
    cluster = str(cluster_file(person.folder, "lab", LOCAL))
    assert person.runs("deploy", "up", cluster).returncode == 0
    try:
        done = person.runs("bench", "paper", "shells.nrrd", "--cluster", cluster)
        assert done.returncode == 2 and "deploy down" in done.stderr
    finally:
        assert person.runs("deploy", "down", cluster).returncode == 0


@pytest.mark.parametrize("options", [("--workers", "3"), ("--listen", "127.0.0.1:9")])
def test_what_a_cluster_cannot_be_measured_by_is_one_line(person: Person, options: tuple[str, str]) -> None:
    cluster = str(cluster_file(person.folder, "lab", LOCAL))
    done = person.runs("bench", "scaling", "shells.nrrd", "--cluster", cluster, *options)
    assert done.returncode == 2 and options[0] in done.stderr and done.stderr.count("\n") == 1
