"""The launcher of Slurm without a Slurm: the folder that nodes share, which may lie where anybody writes, so that the
token goes into one's own alone; and the cures of what `sbatch` says."""

import os
import re
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launcher_keys import SlurmKeys
from volsplat.deploy.launchers.launcher import Secrets, ServerOrder
from volsplat.deploy.launchers.slurm import SlurmLauncher
from volsplat.deploy.server_command import Program
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.tokens import new_token

NOBODY = 65534


def start(shared: Path, *orders: ServerOrder) -> None:
    machine = Machine(launcher="slurm", slurm=SlurmKeys(folder=str(shared)))
    SlurmLauncher(machine, Path("lab")).start(orders, Secrets(new_token(), Path("token")), lambda line: None)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def open_to_others(folder: Path) -> None:
    folder.mkdir(parents=True)
    folder.chmod(0o770)


def a_link(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(parents=True)
    folder.symlink_to(folder.parent / "elsewhere")


def a_file(folder: Path) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.write_text("")


def of_another(folder: Path) -> None:
    folder.mkdir(parents=True, mode=0o700)
    os.chown(folder, NOBODY, NOBODY)


def test_the_token_lies_where_its_owner_alone_reads_and_writes(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    for _ in range(2):  # made, and found
        start(tmp_path)
        folder = tmp_path / "lab" / "slurm"
        assert mode(folder.parent) == mode(folder) == 0o700
        assert mode(folder / "token") == 0o600


@pytest.mark.parametrize("name", ["lab", "lab/slurm"])
@pytest.mark.parametrize("make", [open_to_others, a_link, a_file, of_another])
def test_a_folder_that_others_could_write_to_is_refused(
    make: Callable[[Path], None], name: str, tmp_path: Path
) -> None:
    if make is of_another and os.geteuid() != 0:
        pytest.skip("only root gives folders away")
    make(tmp_path / name)
    with pytest.raises(BadInput, match=f"{name} (is not a folder that you alone|cannot be made)"):
        start(tmp_path)
    assert not [found for found in tmp_path.rglob("*") if found.name.startswith("token")]


@pytest.mark.parametrize(
    "said, cure",
    [
        (
            "Batch job submission failed: Invalid account or account/partition combination specified",
            "see slurm.options",
        ),
        ("invalid partition specified: none", "see slurm.options"),
        ("Batch job submission failed: Requested node configuration is not available", "see slurm.options"),
        ("Memory specification can not be satisfied", "see slurm.options"),
        (
            "Batch job submission failed: Requested time limit is invalid (missing or exceeds some limit)",
            "see slurm.options",
        ),
        ("Batch job submission failed: Invalid qos specification", "see slurm.options"),
        (
            "Batch job submission failed: Job violates accounting/QOS policy (job submit limit, "
            "user's size and/or time limits)",
            "see slurm.options",
        ),
        ("unrecognized option '--patition=long'", "see slurm.options"),
        ("Batch job submission failed: Invalid authentication credential", "try: scontrol ping"),
        ("Batch job submission failed: Protocol authentication error", "try: scontrol ping"),
        ("Batch job submission failed: Resource temporarily unavailable", "try: scontrol ping"),
        ("resolve_ctls_from_dns_srv: Could not establish a configuration source", "try: scontrol ping"),
        ("Batch job submission failed: Unable to contact slurm controller (connect failure)", "try: scontrol ping"),
        ("Batch job submission failed: Socket timed out on send/recv operation", "try: scontrol ping"),
    ],
)
def test_a_job_that_is_turned_down_is_cured_by_its_options(
    said: str, cure: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sbatch = tmp_path / "sbatch"
    sbatch.write_text(f"#!/bin/sh\ncat >&2 <<'END'\nsbatch: error: {said}\nEND\nexit 1\n", encoding="utf-8")
    sbatch.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(BadInput, match=rf"{re.escape(said)}; {cure}"):
        start(tmp_path / "shared", ServerOrder("splat-1", Program.SPLAT_SERVER, ()))
