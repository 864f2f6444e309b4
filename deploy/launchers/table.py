"""Which launchers there are, by the name that a cluster file gives them."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Launcher, StartedServer


class Row(NamedTuple):
    """A launcher's class, which is called with the machine's table of the cluster file and a folder for its files,
    and imported only where it is used: engines bring libraries."""

    summary: str
    module: str
    name: str


LAUNCHERS = {
    "local": Row("processes of this machine", "volsplat.deploy.launchers.local", "LocalLauncher"),
    "ssh": Row("OpenSSH, with your own config and keys", "volsplat.deploy.launchers.ssh", "SshLauncher"),
    "dask": Row("tasks of a Dask cluster", "volsplat.deploy.launchers.dask", "DaskLauncher"),
    "slurm": Row("jobs of a Slurm cluster", "volsplat.deploy.launchers.slurm", "SlurmLauncher"),
    "kubernetes": Row("manifests to apply", "volsplat.deploy.launchers.kubernetes", "KubernetesLauncher"),
    "manual": Row("prints what to type on each machine", "volsplat.deploy.launchers.manual", "ManualLauncher"),
}


def launcher_of(machine: Machine, folder: Path) -> Launcher:
    """The launcher of a machine. `folder` (mode 0700) is for its logs, and for files that only its owner may read."""
    row = LAUNCHERS[machine.launcher]
    launcher: Launcher = getattr(import_module(row.module), row.name)(machine, folder)
    return launcher


def host_name(machine: Machine) -> str | None:
    """A host on the network of a machine's servers, where they themselves are if its launcher knows that.

    None where it knows neither. Raises BadInput.
    """
    found = getattr(import_module(LAUNCHERS[machine.launcher].module), "host_name", None)
    return machine.host if found is None else found(machine)


def cancelling(machine: Machine, servers: Sequence[StartedServer]) -> str:
    """The command that ends those which have not begun yet, by an engine that may keep them waiting; else empty."""
    found = getattr(import_module(LAUNCHERS[machine.launcher].module), "cancelling", None)
    return "" if found is None else str(found(machine, servers))
