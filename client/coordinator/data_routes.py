"""Who sends packets to whom: every map/shade server with a part of the volume to every splat server."""

from collections import Counter
from collections.abc import Iterable
from shlex import quote

from volsplat.client.coordinator.events.events import ServerJoined
from volsplat.client.coordinator.events.instructions import Instruction, ReportProgress, Send
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.session_messages import ConnectToSplatServers, InviteWorkers, Route
from volsplat.protocol.text.errors import PeerLost, VolsplatError
from volsplat.protocol.wire.addresses import Address, everywhere, is_loopback, reached_from

MOST_MADE_ANEW = 3  # times before another frame is whole: then the way between the two is at fault


class DataRoutes:
    """What a worker says of links that it was asked for before the newest request counts for nothing."""

    def __init__(self, servers: Servers) -> None:
        self._servers = servers
        self._asked: Counter[int] = Counter()  # requests that have no answer yet, by worker
        self._made_anew: Counter[tuple[int, int]] = Counter()  # links of a worker and a splat server, likewise
        self._linked: dict[int, bool] = {}  # by worker, once it has said so
        self._linking: set[int] = set()  # workers that make one anew, and have not answered

    def invite(self, workers: Iterable[int]) -> list[Instruction]:
        """Have the splat servers take the links of these workers."""
        keys = {worker: self._servers.joined[worker].key for worker in workers}
        return [Send(splat, InviteWorkers(keys=keys)) for splat in self._servers.splat_servers]

    def connect(self, workers: Iterable[int]) -> list[Instruction]:
        """Have these workers link to the splat servers that are there, and to no other."""
        return [self._connect(worker) for worker in workers]

    def why_apart(self, worker: int, splat: int, lost: int) -> str:
        """Why they have no link, of whom one is `lost` for that."""
        there, here = self._servers.joined[splat], self._servers.joined[worker]
        if _may_reach(there, here):
            missed, other = (here, there) if lost == worker else (there, here)
            return f"{missed.name} has no connection to {other.name}"
        return (
            f"{there.name} listens on its own machine alone, at {there.data}, but {here.name} is on another one; "
            f"start the splat server with --listen {quote(str(everywhere(here.host)))}, or --advertise HOST:PORT"
        )

    def cure(self, worker: int, error: VolsplatError) -> str:
        """What is added to this error: where a splat server was dialled in vain, another address may reach it."""
        joined = self._servers.joined
        between = any(joined[n].elsewhere for n in (worker, *self._servers.splat_servers) if n in joined)
        if not between or not isinstance(error, PeerLost):
            return ""
        return "; or tell the splat server where it is reached: --advertise HOST"

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
        here = self._servers.joined[worker]
        others = [self._servers.joined[splat] for splat in self._servers.splat_servers if splat != but]
        places = [(splat.server, _reached(splat, here)) for splat in others if _may_reach(splat, here)]
        routes = [Route(server=splat, host=data.host, port=data.port, key=here.key) for splat, data in places]
        return Send(worker, ConnectToSplatServers(routes=routes))

    def connected(self, worker: int, reached: list[int]) -> list[int]:
        """A worker has linked to these; the splat servers that it was to link to as well are in the answer."""
        self._linked[worker] = bool(reached)
        return [] if self._outdated(worker) else [n for n in self._servers.splat_servers if n not in reached]

    def some_are_linked(self, workers: Iterable[int]) -> bool:
        """Whether any of these workers has said that it reaches a splat server."""
        return any(self._linked.get(worker) for worker in workers)

    def refused(self, worker: int) -> bool:
        """Whether the worker can reach nobody who is there now."""
        self._linked[worker] = False
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


def _may_reach(splat: ServerJoined, worker: ServerJoined) -> bool:
    """Else whatever the worker tries, it dials its own machine, which the splat server is not on."""
    if is_loopback(worker.host) or not is_loopback(_reached(splat, worker).host):
        return True
    return worker.host == (worker.client_host if is_loopback(splat.host) else splat.host)
