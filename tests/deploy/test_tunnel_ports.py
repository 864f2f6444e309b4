"""What tunnels carry: a port of any machine's loopback leads to the one server, or the client, that it stands for."""

from hypothesis import given
from hypothesis import strategies as st

from support.programs.clusters import ordered
from volsplat.deploy.cluster.orders import Ordered
from volsplat.deploy.cluster_file import Cluster, Machine
from volsplat.deploy.launcher_keys import SshKeys
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.ports import Way, last_port, ways
from volsplat.protocol.wire.addresses import LOOPBACK, Address, parse_address

CLIENT_PORT = 7000
HERE = None  # the client's machine, as a host
COUNTS = st.integers(0, 3)


@st.composite
def machines(draw: st.DrawFn) -> Machine:
    map_shade, splat = draw(st.tuples(COUNTS, COUNTS).filter(any))
    host = draw(st.sampled_from([HERE, "a", "b", "c"]))
    if host is HERE:
        return Machine(launcher="local", map_shade_servers=map_shade, splat_servers=splat)
    keys = SshKeys(tunnel=True)
    return Machine(launcher="ssh", host=host, ssh=keys, map_shade_servers=map_shade, splat_servers=splat)


CLUSTERS = st.lists(machines(), min_size=1, max_size=6).map(lambda made: Cluster(name="lab", machines=tuple(made)))


def told(one: Ordered, option: str) -> Address | None:
    arguments = one.order.arguments
    return parse_address(arguments[arguments.index(option) + 1]) if option in arguments else None


def comes_to(port: int, host: str | None, tunnels: list[Way], listening: dict[tuple[str | None, int], str]) -> str:
    """Who answers at a port of this host's loopback."""
    if (host, port) in listening:
        return listening[host, port]
    if host is not HERE:
        assert any(tunnel.machine.host == host and port in tunnel.here for tunnel in tunnels)
        return comes_to(port, HERE, tunnels, listening)
    (leads,) = (tunnel.machine.host for tunnel in tunnels if port in tunnel.there)
    return listening[leads, port]


@given(CLUSTERS)
def test_each_server_reaches_the_client_and_each_map_shade_server_each_splat_server(cluster: Cluster) -> None:
    tunnels = ways(cluster, CLIENT_PORT)
    servers = ordered(cluster, CLIENT_PORT)
    hosts = {one.order.name: cluster.machines[one.machine].host for one in servers}
    listening: dict[tuple[str | None, int], str] = {(HERE, CLIENT_PORT): "client"}
    splats = [one for one in servers if one.order.program is Program.SPLAT_SERVER]
    for one in splats:
        if (address := told(one, "--listen")) is not None:
            assert address.host == LOOPBACK and (hosts[one.order.name], address.port) not in listening
            listening[hosts[one.order.name], address.port] = one.order.name
    for one in servers:
        assert told(one, "--connect") == (LOOPBACK, CLIENT_PORT)
        assert comes_to(CLIENT_PORT, hosts[one.order.name], tunnels, listening) == "client"
        if one.order.program is Program.MAPSHADE_SERVER:
            for splat in splats:
                address = told(splat, "--listen")
                if address is None:  # at a port that the system chooses
                    assert hosts[splat.order.name] is hosts[one.order.name] is HERE
                else:
                    assert comes_to(address.port, hosts[one.order.name], tunnels, listening) == splat.order.name


@given(CLUSTERS)
def test_ssh_listens_at_no_port_twice(cluster: Cluster) -> None:
    tunnels = ways(cluster, CLIENT_PORT)
    assert len({tunnel.machine.host for tunnel in tunnels}) == len(tunnels)
    here = [port for tunnel in tunnels for port in tunnel.there]
    assert len(set(here)) == len(here) and CLIENT_PORT not in here
    for tunnel in tunnels:
        assert len(set(tunnel.here)) == len(tunnel.here) and not set(tunnel.here) & set(tunnel.there)
        assert max((*tunnel.here, *tunnel.there)) <= last_port(cluster, CLIENT_PORT)


def test_a_splat_server_that_advertises_itself_is_dialled_directly() -> None:
    keys = SshKeys(tunnel=True)
    open_one = Machine(launcher="ssh", host="a", ssh=keys, map_shade_servers=1, splat_servers=1, advertise="a.lab")
    other = Machine(launcher="ssh", host="b", ssh=keys, map_shade_servers=1)
    cluster = Cluster(name="lab", machines=(open_one, other))
    assert [(way.here, way.there) for way in ways(cluster, CLIENT_PORT)] == [((CLIENT_PORT,), ())] * 2
    assert told(ordered(cluster, CLIENT_PORT)[0], "--listen") == ("0.0.0.0", 0)
