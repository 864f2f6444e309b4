"""Where map/shade servers are told to find splat servers: by each one's own way to it."""

from dataclasses import replace

import pytest

from support.messages.coordinated import FIRST, JOINED, SECOND, WHOLE, CheckedCoordinator, joins, said
from support.messages.message_samples import IDENTITY
from volsplat.client.coordinator.data_routes import DataRoutes
from volsplat.client.coordinator.events.events import ServerJoined, VolumeAsked
from volsplat.client.coordinator.events.instructions import Instruction, ReportLoss, Send
from volsplat.client.coordinator.servers import Servers
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import ConnectToSplatServers
from volsplat.protocol.wire.addresses import LOOPBACK, Address

DESK, NODE = "10.0.0.1", "10.0.0.7"  # the client's machine as others see it, and another one


def routes_of(splat: ServerJoined, worker: ServerJoined) -> DataRoutes:
    servers = Servers()
    servers.joined = {1: splat, 2: worker}
    servers.splat_servers = [1]
    return DataRoutes(servers)


def dialled_hosts(routes: DataRoutes) -> list[str]:
    """That the worker is told of."""
    (sent,) = routes.connect([2])
    assert isinstance(sent, Send) and isinstance(sent.message, ConnectToSplatServers)
    return [route.host for route in sent.message.routes]


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
        (splat(LOOPBACK, LOOPBACK, False), worker(DESK, DESK), LOOPBACK),  # on the client's machine, by its address
        (splat(NODE, LOOPBACK, False), worker(NODE, DESK), LOOPBACK),
    ],
    ids=["one machine", "splat server here", "splat server there", "advertised", "both here", "both there"],
)
def test_a_worker_dials_what_it_can_reach(server: ServerJoined, caller: ServerJoined, dialled: str) -> None:
    assert dialled_hosts(routes_of(server, caller)) == [dialled]


@pytest.mark.parametrize(
    ("there", "node", "listen"), [(DESK, NODE, "0.0.0.0:0"), ("fd77::1", "fd77::7", "'[::]:0'"), ("10.0.0.9", NODE, "")]
)
def test_nobody_dials_a_splat_server_that_listens_on_another_machine_alone_and_the_cure_is_told(
    there: str, node: str, listen: str
) -> None:
    routes = routes_of(splat(there, LOOPBACK, False), worker(node, DESK))
    assert dialled_hosts(routes) == []
    assert f"with --listen {listen}" in (why := routes.why_apart(2, 1, 1)) and "--advertise" in why


def far_from_each_other(*more: ServerJoined, by_hand: bool = False) -> tuple[CheckedCoordinator, list[Instruction]]:
    """A splat server that listens on its own machine alone, and a worker on another one, beside `more`."""
    coordinator = CheckedCoordinator()
    near, far = (replace(one, by_hand=by_hand) for one in JOINED[:2])
    near = replace(near, data=Address(LOOPBACK, 7))
    asked = VolumeAsked("/volumes/head.nrrd", workers=1 + len(more))
    described = said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY))
    for event in [*joins(near, far, *more), asked, described]:
        coordinator.handle(event)
    return coordinator, coordinator.handle(said(FIRST, messages.ConnectedToSplatServers([])))


def test_without_another_worker_a_session_of_servers_by_hand_ends_at_once_with_the_cure() -> None:
    coordinator, _ = far_from_each_other(by_hand=True)
    assert coordinator.failure is not None and "start the splat server with --listen" in str(coordinator.failure)


def test_a_worker_on_the_splat_server_s_machine_draws_without_the_one_elsewhere() -> None:
    coordinator, told = far_from_each_other(replace(JOINED[2], host=JOINED[0].host))
    (loss,) = [one.text for one in told if isinstance(one, ReportLoss)]
    assert "start the splat server with --listen" in loss and coordinator.failure is None
    assert list(coordinator.holding.boxes) == [SECOND]
