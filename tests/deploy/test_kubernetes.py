"""Manifests for Kubernetes: valid, without a secret where others look, and their commands are servers that draw."""

import json
import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, get_args

import kubernetes_validate
import pytest

from support.patience import wait_until
from support.programs.clusters import cluster_file, drawn
from support.programs.hand_started import free_port
from support.programs.programs import VOLSPLAT, Person
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session import cluster_watch
from volsplat.client.session.cluster_watch import ClusterWatch
from volsplat.deploy.cluster_file import LauncherName
from volsplat.deploy.launchers.table import LAUNCHERS
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE

SCHEMA = "1.30"
MACHINE = 'launcher = "kubernetes"\nmap-shade-servers = 2\nsplat-servers = 1\nthreads = 1\n'
IMAGE = 'kubernetes.image = "registry.lab/volsplat:1"\n'

Manifest = dict[str, Any]


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", size=(24, 24, 24)))
    return Person(tmp_path)


@pytest.fixture
def cluster(person: Person) -> Iterator[Path]:
    """Its pods are to be processes of this machine."""
    keys = (
        f'{IMAGE}kubernetes.resources = {{memory = "1Gi"}}\nkubernetes.claim = "scans"\nkubernetes.namespace = "lab"\n'
    )
    here = f'command = "{VOLSPLAT}"\ndata-root = "{person.folder}"\nadvertise = "127.0.0.1"\n'
    path = cluster_file(person.folder, "A.lab_1", MACHINE + keys + here)
    path.write_text(f'client = "127.0.0.1:{free_port()}"\n{path.read_text(encoding="utf-8")}')
    try:
        yield path
    finally:
        assert person.runs("deploy", "down", str(path)).returncode == 0


def manifests(person: Person, cluster: Path) -> list[Manifest]:
    """What `deploy up` writes, in a file for its owner alone."""
    up = person.runs("deploy", "up", str(cluster))
    assert up.returncode == 0, up.stderr
    (path,) = (person.folder / "state").glob("volsplat/clusters/A.lab_1/*splat.json")
    assert f"kubectl replace --force -f {path}\n" in up.stderr and path.stat().st_mode & 0o777 == 0o600
    items: list[Manifest] = json.loads(path.read_text(encoding="utf-8"))["items"]
    return items


def containers(items: list[Manifest]) -> list[Manifest]:
    return [item["spec"]["template"]["spec"]["containers"][0] for item in items if item["kind"] == "Job"]


def test_there_is_a_launcher_of_every_name() -> None:
    assert set(LAUNCHERS) == set(get_args(LauncherName))


def test_they_are_valid_and_each_server_has_a_job_of_its_own_name(person: Person, cluster: Path) -> None:
    items = manifests(person, cluster)
    for item in items:
        kubernetes_validate.validate(item, SCHEMA, strict=True)
    kinds = [item["kind"] for item in items]
    assert sorted(kinds) == ["Job", "Job", "Job", "Secret", "Service"]
    names = [(item["kind"], item["metadata"]["name"]) for item in items]
    assert len(set(names)) == len(names) and all(item["metadata"]["namespace"] == "lab" for item in items)


def test_who_brings_it_down_is_told_that_jobs_go_on_and_how_to_end_them(person: Person, cluster: Path) -> None:
    manifests(person, cluster)
    (path,) = (person.folder / "state").rglob("*splat.json")
    said = person.runs("deploy", "down", str(cluster)).stderr
    assert f"kubernetes: Jobs go on: end them by: kubectl delete -f {path}; without" in said
    assert "ending" not in said and said.endswith("A.lab_1 is down, but for 3 servers\n")


def test_the_token_is_in_the_secret_alone(person: Person, cluster: Path) -> None:
    items = manifests(person, cluster)
    (secret,) = [item for item in items if item["kind"] == "Secret"]
    (token,) = secret["stringData"].values()
    assert token == next((person.folder / "state").rglob("token")).read_text(encoding="utf-8").strip()
    assert token not in json.dumps([item for item in items if item is not secret])
    for container in containers(items):
        (variable,) = container["env"]
        assert variable["valueFrom"]["secretKeyRef"]["name"] == secret["metadata"]["name"]


def test_their_commands_draw_as_a_single_process(person: Person, cluster: Path) -> None:
    items = manifests(person, cluster)
    (secret,) = [item for item in items if item["kind"] == "Secret"]
    environment = {**os.environ, TOKEN_VARIABLE: secret["stringData"]["token"]}
    with ExitStack() as ended:
        for container in containers(items):
            server = ended.enter_context(subprocess.Popen(container["command"], env=environment))
            ended.callback(server.terminate)
        assert drawn(person, "--cluster", str(cluster)) == drawn(person, "--single")


def test_pods_that_come_one_after_another_are_waited_for(
    person: Person, cluster: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_watch, "UNHEARD_SECONDS", 0.0)
    monkeypatch.setattr(cluster_watch, "LOOK_SECONDS", 0.05)
    items = manifests(person, cluster)
    (secret,) = [item for item in items if item["kind"] == "Secret"]
    environment = {**os.environ, TOKEN_VARIABLE: secret["stringData"]["token"]}
    *first, last = (container["command"] for container in containers(items))
    looks = list[list[str]]()
    looked = ClusterWatch._missing

    def noted(self: ClusterWatch) -> list[str]:
        looks.append(looked(self))
        return looks[-1]

    monkeypatch.setattr(ClusterWatch, "_missing", noted)
    said = list[str]()
    with (
        ExitStack() as ended,
        Session(person.folder / "head.nrrd", cluster=cluster, on_progress=said.append) as session,
    ):

        def started(command: list[str]) -> None:
            server = ended.enter_context(subprocess.Popen(command, env=environment))
            ended.callback(server.terminate)

        for command in first:
            started(command)
        wait_until(lambda: [len(missing) for missing in looks[-3:]] == [1, 1, 1], "all but one are there")
        started(last)
        assert session.volume and not any("the others draw without" in line for line in said)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("", "needs kubernetes.image"),
        (IMAGE + 'kubernetes.claim = "scans"\n', "needs data-root"),
        (IMAGE + 'kubernetes.namespace = "My Lab"\n', "is no name of one"),
        (IMAGE + 'kubernetes.namespace = ""\n', "is no name of one"),
        (IMAGE + 'metrics = "0.0.0.0:9100"\nmetrics-token = "/tmp/scrape"\n', "leave it out"),
        (IMAGE, "add client"),
    ],
)
def test_what_no_manifest_can_be_made_of_is_one_line(person: Person, keys: str, said: str) -> None:
    path = cluster_file(person.folder, "bad", MACHINE + keys)
    if "client" not in said:
        path.write_text(f'client = "10.0.0.1:7400"\n{path.read_text(encoding="utf-8")}')
    up = person.runs("deploy", "up", str(path))
    assert up.returncode == 2 and said in up.stderr, up.stderr
