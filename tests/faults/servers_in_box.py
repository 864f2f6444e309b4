"""Servers on the hosts of a lab in a box, which the launcher `ssh` starts, and starts anew if they are lost."""

import os
import random
from collections.abc import Sequence
from pathlib import Path

import psutil
from faults.kinds_of_fault import FAULTS, LINK_DOWN, Fault

from support.lab.box import GIGABIT, Box
from support.lab.host_network import HostNetwork
from volsplat.client import Session
from volsplat.deploy.restart_limit import MOST_RESTARTS
from volsplat.deploy.server_command import Program

SPLAT, WORKERS = ("splat-1", "splat-2"), ("worker-1", "worker-2", "worker-3")
HOSTS = (*SPLAT, *WORKERS)
KEYS = {Program.SPLAT_SERVER: "splat-servers", Program.MAPSHADE_SERVER: "map-shade-servers"}


class HostServer:
    """One process, and the network of the host that is its alone."""

    def __init__(self, program: Program, box: Box, name: str, process: int) -> None:
        self.program = program
        self.process = psutil.Process(process)
        self.network = HostNetwork(box.hosts[name], self.process, GIGABIT)


class ServersInBox:
    """The servers of one session, one on each host."""

    faults: Sequence[Fault] = (*FAULTS, LINK_DOWN)
    most_losses = MOST_RESTARTS  # of servers in one session: more in a minute are not replaced

    def __init__(self, box: Box, folder: Path, volume: Path, chance: random.Random) -> None:
        self._box = box
        self.workers, self.splat_servers = chance.randint(1, len(WORKERS)), chance.randint(1, len(SPLAT))
        self._hosts = {name: Program.SPLAT_SERVER for name in SPLAT[: self.splat_servers]}
        self._unhealed = False  # a network, since the harm was to last
        self._hosts |= {name: Program.MAPSHADE_SERVER for name in WORKERS[: self.workers]}
        cluster = folder / "cluster.toml"
        machines = (box.machine(name, KEYS[program]) for name, program in self._hosts.items())
        cluster.write_text(f'name = "faults-{os.getpid()}"\n' + "".join(machines), encoding="utf-8")
        self.session = Session(volume, cluster=cluster, on_progress=lambda line: None)

    @property
    def living(self) -> list[HostServer]:
        return [
            HostServer(program, self._box, name, process)
            for name, program in self._hosts.items()
            for process in self._box.servers(name)
        ]

    def replace(self, number: int) -> None:
        """The session's own business, through the launcher."""
        self._unhealed = True

    def joined(self) -> bool:
        """Whether there are as many as at first, and nothing is left of what lost them."""
        joined = sum(not server.lost for server in self.session.servers) >= len(self._hosts)
        if joined and self._unhealed:
            self._heal()
        return joined

    def _heal(self) -> None:
        for server in self.living:
            server.network.heal()
        self._unhealed = False

    def close(self) -> None:
        """Brings the cluster down as well, which was brought up for this session."""
        self._heal()
        self.session.close()
