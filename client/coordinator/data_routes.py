"""Who sends packets to whom: every map/shade server with a part of the volume to every splat server."""

from collections import Counter
from collections.abc import Iterable

from volsplat.client.coordinator.coordinator_events import Instruction, MessageReceived, Send
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.session_messages import (
    ConnectedToSplatServers,
    ConnectToSplatServers,
    InviteWorkers,
    Route,
)


class DataRoutes:
    """What a worker says of links that it was asked for before the newest request counts for nothing."""

    def __init__(self, servers: Servers) -> None:
        self._servers = servers
        self._asked: Counter[int] = Counter()  # requests that have no answer yet, by worker

    def invite(self, workers: Iterable[int]) -> list[Instruction]:
        """Have the splat servers take the links of these workers."""
        keys = {worker: self._servers.joined[worker].key for worker in workers}
        return [Send(splat, InviteWorkers(keys=keys)) for splat in self._servers.splat_servers]

    def connect(self, workers: Iterable[int]) -> list[Instruction]:
        """Have these workers link to the splat servers that are there, and to no other."""
        return [self._connect(worker) for worker in workers]

    def _connect(self, worker: int) -> Send:
        self._asked[worker] += 1
        joined, key = self._servers.joined, self._servers.joined[worker].key
        places = [(splat, joined[splat].data) for splat in self._servers.splat_servers]
        routes = [Route(server=splat, host=data.host, port=data.port, key=key) for splat, data in places]
        return Send(worker, ConnectToSplatServers(routes=routes))

    @takes(ConnectedToSplatServers)
    def _connected(self, message: ConnectedToSplatServers, event: MessageReceived) -> list[Instruction]:
        self._asked[event.server] -= 1
        return []

    def refused(self, worker: int) -> bool:
        """Whether the worker cannot reach who is there now."""
        self._asked[worker] -= 1
        return not self._asked[worker]
