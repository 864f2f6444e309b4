"""A cluster on hosts of their own, brought up by one command through ssh: the same picture, bit for bit, as here."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.files.head_volume import head
from support.files.images import read_image
from support.lab.box import NAMES, Box, box, why_no_box
from support.patience import PATIENCE, wait_until
from support.programs.programs import VOLSPLAT

__all__ = ["head"]

WHY_NOT = why_no_box()
pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)

CT_HEAD = ROOT.parent / "shared" / "data" / "ct_head" / "ct_head_96x128x113.nrrd"
PICTURE = ("--size", "160x160", "--preset", "ct-skin")
WORKERS = [name for name in NAMES if name.startswith("worker")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    with box(tmp_path_factory.mktemp("box")) as made:
        yield made


@pytest.fixture
def volume(head: Path) -> Path:
    return CT_HEAD if CT_HEAD.is_file() else head


def machine(box: Box, name: str, servers: str) -> str:
    return (
        f'[[machines]]\nlauncher = "ssh"\nhost = "{name}"\n{servers} = 1\nthreads = 1\n'
        f'command = "{VOLSPLAT}"\nssh.options = ["-F", "{box.ssh_config}"]\n'
    )


def cluster_file(box: Box, folder: Path) -> Path:
    path = folder / "cluster.toml"
    told = [machine(box, "splat", "splat-servers"), *(machine(box, name, "map-shade-servers") for name in WORKERS)]
    path.write_text('name = "lab-in-a-box"\n' + "".join(told), encoding="utf-8")
    return path


def runs(box: Box, folder: Path, *words: str) -> str:
    """The command on the client's host."""
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / "state")}
    command = [*box.hosts["client"].inside, str(VOLSPLAT), *words]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_cluster_brought_up_through_ssh_draws_each_bit_as_a_single_process(
    whole: Box, volume: Path, tmp_path: Path
) -> None:
    cluster = cluster_file(whole, tmp_path)
    runs(whole, tmp_path, "deploy", "up", cluster.name)
    try:
        serving = [name for name in NAMES if name != "client"]
        wait_until(lambda: all(len(whole.servers(name)) == 1 for name in serving), "with one server on each host")
        assert not whole.servers("client")
        for image in ("first.exr", "second.exr"):  # the servers outlive their client
            runs(whole, tmp_path, "render", str(volume), "--cluster", cluster.name, *PICTURE, "--output", image)
    finally:
        runs(whole, tmp_path, "deploy", "down", cluster.name)
    wait_until(lambda: not any(map(whole.servers, whole.hosts)), "without servers")
    runs(whole, tmp_path, "render", str(volume), "--single", *PICTURE, "--output", "alone.exr")
    alone = read_image(tmp_path / "alone.exr")
    assert alone.any()
    assert all(read_image(tmp_path / image).equal(alone) for image in ("first.exr", "second.exr"))
