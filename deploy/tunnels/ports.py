"""Which ports a cluster's tunnels carry.

A port that is carried has one number on every machine, and is open to that machine's loopback alone: where it begins, a
server or the client listens; everywhere else ssh does.
"""

from collections.abc import Mapping
from typing import NamedTuple

from volsplat.deploy.cluster_file import Cluster, Machine


class Way(NamedTuple):
    """What the tunnel to one host carries."""

    machine: Machine  # the host's first table in the cluster file, by which ssh is called
    here: tuple[int, ...]  # ports that lead from there to this machine
    there: tuple[int, ...]  # ports that lead from here to that host

    def __str__(self) -> str:
        ways = (("from there to here", self.here), ("from here to there", self.there))
        return ", ".join(f"{', '.join(map(str, ports))} {way}" for way, ports in ways if ports)


def splat_ports(cluster: Cluster, listen_port: int) -> Mapping[int, tuple[int, ...]]:
    """The ports of splat servers that some map/shade server reaches by a tunnel, by their machine's place in the file.

    They follow that at which the client listens.
    """
    tunnelled = any(machine.behind_tunnel and machine.map_shade_servers for machine in cluster.machines)
    ports, free = {}, listen_port + 1
    for number, machine in enumerate(cluster.machines):
        if machine.hides_splat_servers or (machine.launcher == "local" and tunnelled and machine.splat_servers):
            ports[number] = tuple(range(free, free + machine.splat_servers))
            free += machine.splat_servers
    return ports


def last_port(cluster: Cluster, listen_port: int) -> int:
    """The last one that tunnels carry, or the client's own."""
    return max((ports[-1] for ports in splat_ports(cluster, listen_port).values()), default=listen_port)


def ways(cluster: Cluster, listen_port: int) -> list[Way]:
    """One for each host that needs a tunnel."""
    ports = splat_ports(cluster, listen_port)
    hosts: dict[str | None, list[int]] = {}
    for number, machine in enumerate(cluster.machines):
        if machine.behind_tunnel:
            hosts.setdefault(machine.host, []).append(number)
    return [_way(cluster, numbers, ports, listen_port) for numbers in hosts.values()]


def _way(cluster: Cluster, numbers: list[int], ports: Mapping[int, tuple[int, ...]], listen_port: int) -> Way:
    """To the host that has these tables."""
    machines = enumerate(cluster.machines)
    working = {number for number, machine in machines if machine.map_shade_servers}  # they dial splat servers
    own = [port for number in numbers for port in ports.get(number, ())]
    others = [port for number, those in ports.items() if number not in numbers for port in those]
    dials, dialled = working & set(numbers), working - set(numbers)
    return Way(
        machine=cluster.machines[numbers[0]],
        here=(listen_port, *(others if dials else ())),
        there=tuple(own if dialled else ()),
    )
