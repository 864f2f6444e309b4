"""All tunnels of a cluster, for as long as one client has them open."""

import math

from volsplat.deploy.cluster_file import Cluster
from volsplat.deploy.launchers.launcher import Report
from volsplat.deploy.tunnels.ports import ways
from volsplat.deploy.tunnels.tunnel import Tunnel


class Tunnels:
    """None if all machines are reached without."""

    def __init__(self, cluster: Cluster, listen_port: int, report: Report) -> None:
        """Begins to open them, to a client that listens at this port."""
        self._cluster = cluster
        self.all = [Tunnel(way, report) for way in ways(cluster, listen_port)]

    def failure(self, machine: int) -> str:
        """Why the tunnel to a machine, by its place in the cluster file, is not open; empty if it is or needs none."""
        tunnel = self._to(machine)
        why = tunnel.failure(0) if tunnel is not None else ""
        return why and f"the tunnel to {self._cluster.machines[machine].title}: {why}"

    def open_for(self, machine: int) -> float:
        """For how many seconds it has been open; inf if none is needed."""
        tunnel = self._to(machine)
        return math.inf if tunnel is None else tunnel.open_for

    def _to(self, machine: int) -> Tunnel | None:
        one = self._cluster.machines[machine]
        return next((tunnel for tunnel in self.all if one.behind_tunnel and tunnel.host == one.host), None)

    def close(self) -> None:
        for tunnel in self.all:
            tunnel.close()
