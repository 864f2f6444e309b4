"""Which launchers there are, by the name that a cluster file gives them."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Launcher, StartedServer

# What makes each, in the module of its name, which is imported only where it is used: engines bring libraries.
LAUNCHERS = {
    "local": "local_launcher",
    "ssh": "ssh_launcher",
    "dask": "DaskLauncher",
    "slurm": "SlurmLauncher",
    "kubernetes": "KubernetesLauncher",
    "manual": "ManualLauncher",
}


def launcher_of(machine: Machine, folder: Path) -> Launcher:
    """The launcher of a machine. `folder` (mode 0700) is for its logs, and for files that only its owner may read."""
    launcher: Launcher = getattr(_module(machine), LAUNCHERS[machine.launcher])(machine, folder)
    return launcher


def host_name(machine: Machine) -> str | None:
    """A host on the network of a machine's servers, where they themselves are if its launcher knows that.

    None where it knows neither. Raises BadInput.
    """
    found = getattr(_module(machine), "host_name", None)
    return machine.host if found is None else found(machine)


def cancelling(machine: Machine, servers: Sequence[StartedServer]) -> str:
    """The command that ends those which have not begun yet, by an engine that may keep them waiting; else empty."""
    found = getattr(_module(machine), "cancelling", None)
    return "" if found is None else str(found(machine, servers))


def _module(machine: Machine) -> ModuleType:
    return import_module(f"volsplat.deploy.launchers.{machine.launcher}")
