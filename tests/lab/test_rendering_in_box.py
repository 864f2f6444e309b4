"""A cluster on hosts of their own, brought up by one command through ssh: the same picture, bit for bit, as here."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from support.checkout import ROOT
from support.engines.dask import dask_cluster
from support.files.head_volume import head
from support.files.images import read_image
from support.lab.box import GIGABIT, NAMES, Box, box, why_no_box
from support.lab.host_network import HostNetwork, why_unharmed
from support.patience import PATIENCE, wait_until
from support.programs.programs import VOLSPLAT

__all__ = ["head"]

WHY_NOT, WHY_UNHARMED = why_no_box(), why_unharmed()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

CT_HEAD = ROOT.parent / "shared" / "data" / "ct_head" / "ct_head_96x128x113.nrrd"
PICTURE = ("--size", "160x160", "--preset", "ct-skin")
WORKERS = [name for name in NAMES if name.startswith("worker")]
SERVING = [name for name in NAMES if name != "client"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    with box(tmp_path_factory.mktemp("box")) as made:
        yield made


@pytest.fixture
def volume(head: Path) -> Path:
    return CT_HEAD if CT_HEAD.is_file() else head


def cluster_file(box: Box, folder: Path) -> Path:
    path = folder / "cluster.toml"
    told = [box.machine("splat", "splat-servers"), *(box.machine(name, "map-shade-servers") for name in WORKERS)]
    path.write_text('name = "lab-in-a-box"\n' + "".join(told), encoding="utf-8")
    return path


def runs(box: Box, folder: Path, *words: str, status: int = 0) -> str:
    """What the command says on the client's host."""
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
    command = [*box.hosts["client"].inside, str(VOLSPLAT), *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == status, done.stderr
    return done.stdout


@pytest.fixture
def dask(whole: Box, tmp_path: Path) -> Iterator[Path]:
    """A cluster file for a scheduler on one of the hosts, and a worker on each that serves."""
    with dask_cluster(tmp_path, whole.hosts["splat"]) as engine:
        for name in SERVING:
            engine.worker(host=whole.hosts[name])
        path = tmp_path / "dask.toml"
        path.write_text(
            'name = "dask-in-a-box"\n[[machines]]\nlauncher = "dask"\n'
            f'dask.scheduler-file = "{engine.scheduler_file}"\n'
            f"splat-servers = 1\nmap-shade-servers = {len(WORKERS)}\nthreads = 1\n",
            encoding="utf-8",
        )
        yield path


def assert_drawn_alike(whole: Box, volume: Path, cluster: Path) -> None:
    """By a cluster with a server on each host but the client's, twice, and by a single process."""
    folder = cluster.parent
    runs(whole, folder, "deploy", "up", cluster.name)
    try:
        wait_until(lambda: all(map(whole.servers, SERVING)), "with a server on each host")
        assert not whole.servers("client")
        for image in ("first.exr", "second.exr"):  # the servers outlive their client
            runs(whole, folder, "render", str(volume), "--cluster", cluster.name, *PICTURE, "--output", image)
    finally:
        runs(whole, folder, "deploy", "down", cluster.name)
    wait_until(lambda: not any(map(whole.servers, whole.hosts)), "without servers")
    runs(whole, folder, "render", str(volume), "--single", *PICTURE, "--output", "alone.exr")
    alone = read_image(folder / "alone.exr")
    assert alone.any()
    assert all(read_image(folder / image).equal(alone) for image in ("first.exr", "second.exr"))


def test_a_cluster_brought_up_through_ssh_draws_each_bit_as_a_single_process(
    whole: Box, volume: Path, tmp_path: Path
) -> None:
    assert_drawn_alike(whole, volume, cluster_file(whole, tmp_path))


def test_so_does_one_whose_servers_are_tasks_of_dask(whole: Box, volume: Path, dask: Path) -> None:
    assert_drawn_alike(whole, volume, dask)


@pytest.mark.skipif(bool(WHY_UNHARMED), reason=WHY_UNHARMED)
def test_the_doctor_names_a_link_that_carries_small_packets_alone(whole: Box, tmp_path: Path) -> None:
    cluster = str(cluster_file(whole, tmp_path))
    runs(whole, tmp_path, "deploy", "up", cluster)
    host = whole.hosts["worker-1"]
    network = HostNetwork(host, psutil.Process(whole.servers("worker-1")[0]), GIGABIT)
    try:
        network.swallow_large()
        found = runs(whole, tmp_path, "deploy", "doctor", cluster, status=2).splitlines()
    finally:
        network.heal()
        runs(whole, tmp_path, "deploy", "down", cluster)
    wrong = [line for line in found if line.startswith("WRONG worker-1")]
    assert any("speed: small messages get through, and large ones do not" in line for line in wrong), found
    assert all("MTU" in line for line in wrong if "speed" in line)


@pytest.mark.skipif(bool(WHY_UNHARMED), reason=WHY_UNHARMED)
@pytest.mark.parametrize("by", ["the sender's own firewall", "the receiver's"])
def test_a_link_between_two_servers_that_carries_small_packets_alone_holds_no_frame_up(
    whole: Box, head: Path, tmp_path: Path, by: str
) -> None:
    """Both are well, and the client reaches both."""
    path = cluster_file(whole, tmp_path)
    path.write_text(f"silence = 1\n{path.read_text(encoding='utf-8')}", encoding="utf-8")
    runs(whole, tmp_path, "deploy", "up", path.name)
    worker, splat = (whole.hosts[name] for name in ("worker-1", "splat"))
    harmed = "worker-1" if by.startswith("the sender") else "splat"
    network = HostNetwork(whole.hosts[harmed], psutil.Process(whole.servers(harmed)[0]), GIGABIT)
    try:
        if harmed == "splat":
            network.swallow_large_from(worker)
        else:
            network.swallow_large_to(splat)
        runs(whole, tmp_path, "render", str(head), "--cluster", path.name, *PICTURE, "--output", "harmed.exr")
    finally:
        network.heal()
        runs(whole, tmp_path, "deploy", "down", path.name)
    runs(whole, tmp_path, "render", str(head), "--single", *PICTURE, "--output", "alone.exr")
    assert read_image(tmp_path / "harmed.exr").equal(read_image(tmp_path / "alone.exr"))
