"""Who sends packets to whom: every map/shade server with a part of the volume to every splat server."""

from collections import Counter
from collections.abc import Iterable

from volsplat.client.coordinator.coordinator_events import Instruction, ReportProgress, Send, ServerJoined
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.session_messages import ConnectToSplatServers, InviteWorkers, Route
from volsplat.protocol.wire.addresses import Address, is_loopback, reached_from

MOST_MADE_ANEW = 3  # times before another frame is whole: then the way between the two is at fault


class DataRoutes:
    """What a worker says of links that it was asked for before the newest request counts for nothing."""

    def __init__(self, servers: Servers) -> None:
        self._servers = servers
        self._asked: Counter[int] = Counter()  # requests that have no answer yet, by worker
        self._made_anew: Counter[tuple[int, int]] = Counter()  # links of a worker and a splat server, likewise
        self._linking: set[int] = set()  # workers that make one anew, and have not answered

    def invite(self, workers: Iterable[int]) -> list[Instruction]:
        """Have the splat servers take the links of these workers."""
        keys = {worker: self._servers.joined[worker].key for worker in workers}
        return [Send(splat, InviteWorkers(keys=keys)) for splat in self._servers.splat_servers]

    def connect(self, workers: Iterable[int]) -> list[Instruction]:
        """Have these workers link to the splat servers that are there, and to no other."""
        return [told for worker in workers for told in (*self._cut_off(worker), self._connect(worker))]

    def _cut_off(self, worker: int) -> list[Instruction]:
        """What to tell of splat servers that a worker cannot reach, whatever it tries."""
        here = self._servers.joined[worker]
        return [
            ReportProgress(
                f"{splat.name} listens on its own machine alone, at {splat.data}, but {here.name} is on another one; "
                "start the splat server with --listen 0.0.0.0:0, or --advertise HOST:PORT"
            )
            for splat in map(self._servers.joined.__getitem__, self._servers.splat_servers)
            if is_loopback(_reached(splat, here).host) and not is_loopback(here.host)
        ]

    def may_link_anew(self, worker: int, splat: int) -> bool:
        return self._made_anew[worker, splat] < MOST_MADE_ANEW

    def link_anew(self, worker: int, splat: int) -> list[Instruction]:
        """Have a link made anew that has ended, as perhaps one end alone knows."""
        self._made_anew[worker, splat] += 1
        self._linking.add(worker)
        joined = self._servers.joined
        told = ReportProgress(f"{joined[worker].name} links anew to {joined[splat].name}")
        return [told, self._connect(worker, but=splat), self._connect(worker)]

    def drew_whole(self) -> None:
        """All links serve."""
        self._made_anew.clear()

    @property
    def linking_anew(self) -> bool:
        """Whether a link is being made anew, which the next frame needs."""
        return not self._linking.isdisjoint(self._servers.joined)

    def _connect(self, worker: int, but: int | None = None) -> Send:
        self._asked[worker] += 1
        joined, here = self._servers.joined, self._servers.joined[worker]
        places = [(splat, _reached(joined[splat], here)) for splat in self._servers.splat_servers if splat != but]
        routes = [Route(server=splat, host=data.host, port=data.port, key=here.key) for splat, data in places]
        return Send(worker, ConnectToSplatServers(routes=routes))

    def connected(self, worker: int, reached: list[int]) -> list[int]:
        """A worker has linked to these; the splat servers that it was to link to as well are in the answer."""
        return [] if self._outdated(worker) else [n for n in self._servers.splat_servers if n not in reached]

    def refused(self, worker: int) -> bool:
        """Whether the worker can reach nobody who is there now."""
        return not self._outdated(worker)

    def _outdated(self, worker: int) -> bool:
        """Whether it was told anew since what it answers now."""
        self._asked[worker] -= 1
        if self._asked[worker] > 0:
            return True
        self._linking.discard(worker)
        return False


def _reached(splat: ServerJoined, worker: ServerJoined) -> Address:
    """Where a worker reaches a splat server."""
    return reached_from(splat.data, splat.data_anywhere, worker.host, worker.client_host)
