"""A Slurm of a test's own: munged, slurmctld and slurmd on this machine, their files in one folder."""

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port

NEEDED = ("munged", "slurmctld", "slurmd", "sbatch")
CORES = 4  # as it is told: more than there may be, so that servers run side by side

_CONFIG = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=1
KillWait=5
SlurmdParameters=config_overrides
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=100 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES State=UP
"""


def why_no_slurm() -> str:
    """Why this machine cannot hold one; empty if it can."""
    missing = [name for name in NEEDED if _program(name) is None]
    if missing:
        return f"a Slurm needs {', '.join(missing)} (Debian: slurmctld, slurmd, munge)"
    return "" if os.geteuid() == 0 else "a Slurm of its own needs root"


def _program(name: str) -> str | None:
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin")


@contextmanager
def slurm(folder: Path) -> Iterator[dict[str, str]]:
    """The environment in which Slurm's commands find it."""
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True)
    config = folder / "slurm.conf"
    config.write_text(
        _CONFIG.format(
            host=socket.gethostname().partition(".")[0],
            folder=folder,
            controller_port=free_port(),
            node_port=free_port(),
            cores=CORES,
        ),
        encoding="utf-8",
    )
    (folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n", encoding="utf-8")
    environment = {**os.environ, "SLURM_CONF": str(config)}
    with ExitStack() as ended:
        ended.enter_context(_daemon("munged", *_munge_options(folder), environment=environment, log=folder / "munged"))
        wait_until((folder / "munge.socket").exists, "had munged's socket")
        for name in ("slurmctld", "slurmd"):
            ended.enter_context(_daemon(name, "-D", environment=environment, log=folder / name))
        wait_until(lambda: "idle" in _said("sinfo", "--noheader", environment=environment), f"idle, see {folder}")
        yield environment


def _munge_options(folder: Path) -> list[str]:
    key = folder / "munge.key"
    key.touch(0o600)
    key.write_bytes(os.urandom(128))
    places = {name: folder / f"munge.{name}" for name in ("socket", "pid", "log", "seed")}
    return [
        "--foreground",
        "--force",
        f"--key-file={key}",
        f"--socket={places['socket']}",
        f"--pid-file={places['pid']}",
        f"--log-file={places['log']}",
        f"--seed-file={places['seed']}",
    ]


@contextmanager
def _daemon(name: str, *options: str, environment: dict[str, str], log: Path) -> Iterator[None]:
    program = _program(name)
    assert program is not None
    with log.with_suffix(".out").open("wb") as out:
        daemon = subprocess.Popen([program, *options], env=environment, stdout=out, stderr=out)
        try:
            yield
        finally:
            daemon.terminate()
            daemon.wait(PATIENCE)


def _said(*command: str, environment: dict[str, str]) -> str:
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE).stdout
