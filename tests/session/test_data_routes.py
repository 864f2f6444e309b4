"""Where map/shade servers are told to find splat servers: by each one's own way to it."""

import pytest

from volsplat.client.coordinator.coordinator_events import ReportProgress, Send, ServerJoined
from volsplat.client.coordinator.data_routes import DataRoutes
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import ConnectToSplatServers
from volsplat.protocol.wire.addresses import LOOPBACK, Address

DESK, NODE = "10.0.0.1", "10.0.0.7"  # the client's machine as others see it, and another one


def routed(splat: ServerJoined, worker: ServerJoined) -> tuple[str, list[str]]:
    """The host that the worker dials, and what is told beside it."""
    servers = Servers()
    servers.joined = {1: splat, 2: worker}
    servers.splat_servers = [1]
    told = DataRoutes(servers).connect([2])
    (sent,) = [one.message for one in told if isinstance(one, Send)]
    assert isinstance(sent, ConnectToSplatServers)
    return sent.routes[0].host, [one.text for one in told if isinstance(one, ReportProgress)]


def splat(host: str, data: str, anywhere: bool) -> ServerJoined:
    return ServerJoined(1, Role.SPLAT_SERVER, "splat server 1", host, Address(data, 7), data_anywhere=anywhere)


def worker(host: str, client_host: str) -> ServerJoined:
    return ServerJoined(2, Role.MAPSHADE_SERVER, "worker 2", host, Address("", 0), client_host=client_host)


@pytest.mark.parametrize(
    ("server", "caller", "dialled"),
    [
        (splat(LOOPBACK, LOOPBACK, True), worker(LOOPBACK, LOOPBACK), LOOPBACK),
        (splat(LOOPBACK, LOOPBACK, True), worker(NODE, DESK), DESK),  # it joined by localhost
        (splat(NODE, NODE, True), worker(LOOPBACK, LOOPBACK), NODE),
        (splat(LOOPBACK, "desk.lab", False), worker(NODE, DESK), "desk.lab"),  # it says where it is
    ],
    ids=["one machine", "splat server here", "splat server there", "advertised"],
)
def test_a_worker_dials_what_it_can_reach(server: ServerJoined, caller: ServerJoined, dialled: str) -> None:
    assert routed(server, caller) == (dialled, [])


def test_a_splat_server_that_nobody_elsewhere_reaches_is_told_with_the_cure() -> None:
    _, told = routed(splat(LOOPBACK, LOOPBACK, False), worker(NODE, DESK))
    assert len(told) == 1 and "--advertise" in told[0]
