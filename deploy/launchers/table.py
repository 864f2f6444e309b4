"""Which launchers there are, by the name that a cluster file gives them."""

from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Launcher


class Row(NamedTuple):
    """A launcher's class, which is called with the machine's table of the cluster file and a folder for its files,
    and imported only where it is used: engines bring libraries."""

    summary: str
    module: str
    name: str


LAUNCHERS: dict[str, Row] = {}


def launcher_of(machine: Machine, folder: Path) -> Launcher:
    """The launcher of a machine. `folder` (mode 0700) is for its logs, and for files that only its owner may read."""
    row = LAUNCHERS[machine.launcher]
    launcher: Launcher = getattr(import_module(row.module), row.name)(machine, folder)
    return launcher
