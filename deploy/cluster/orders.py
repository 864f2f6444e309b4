"""Which servers a cluster file asks for: their names, their arguments, and where a client finds each."""

import socket
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from typing import NamedTuple

from volsplat.deploy.cluster_file import ENGINES, Cluster, Machine
from volsplat.deploy.launchers.launcher import ServerOrder
from volsplat.deploy.launchers.table import host_name
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.ports import splat_ports
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import EVERYWHERE, EVERYWHERE_6, LOOPBACK, Address, parse_address

SHORT = {Program.SPLAT_SERVER: "splat", Program.MAPSHADE_SERVER: "map/shade"}
DEBIANS_OWN = "127.0.1.1"  # to which Debian resolves a machine's own name: it holds on that machine alone
NOBODY = "192.0.2.1"  # an address for documents (RFC 5737): the way to it is that to everybody
DISCARD_PORT = 9  # to find a route nothing is sent, so any will do


class Wanted(NamedTuple):
    """A server that the file asks for."""

    name: str
    program: Program
    machine: int  # its place in the cluster file


class Ordered(NamedTuple):
    order: ServerOrder
    machine: int  # its place in the cluster file
    wait_at: Address | None  # where clients dial it; None: it dials them


def wanted_servers(cluster: Cluster) -> list[Wanted]:
    """All of them, machine by machine."""
    return [
        Wanted(f"{title} {SHORT[program]}" + (f" {n + 1}" if servers > 1 else ""), program, number)
        for number, (machine, title) in enumerate(zip(cluster.machines, _titles(cluster), strict=True))
        for program in (Program.SPLAT_SERVER, Program.MAPSHADE_SERVER)
        for servers in (_count(machine, program),)
        for n in range(servers)
    ]


def _count(machine: Machine, program: Program) -> int:
    return machine.splat_servers if program is Program.SPLAT_SERVER else machine.map_shade_servers


def _titles(cluster: Cluster) -> list[str]:
    """Of each machine, told apart where two have the same."""
    plain = [machine.title for machine in cluster.machines]
    times, taken = Counter(plain), set(plain)
    titles = []
    for number, title in enumerate(plain, 1):
        numbered = (f"{title}-{free}" for free in count(number))
        titles.append(title if times[title] == 1 else next(one for one in numbered if one not in taken))
        taken.add(titles[-1])
    return titles


def orders_of(cluster: Cluster, servers: Sequence[Wanted], listen_port: int) -> Iterator[Ordered]:
    """Of all servers of one machine. Raises BadInput where no address can be found.

    Asks once for all of them: ssh is started for it, and names are looked up.
    """
    number = servers[0].machine
    machine = cluster.machines[number]
    carried = iter(splat_ports(cluster, listen_port).get(number, ()))
    waits, metrics, advertised = machine.listens_at, machine.metrics_at, machine.advertised_at
    client = client_address(cluster, machine, listen_port) if waits is None else ""
    listens = _data_links(cluster, machine) if machine.splat_servers else LOOPBACK
    dialled_at = _reached_at(machine, waits) if waits is not None else ""
    for name, program, _ in servers:
        arguments = ["--name", name, "--resident"]
        arguments += ["--keep", f"{cluster.keep:g}", "--silence", f"{cluster.silence:g}"]
        arguments += cluster.encryption.options
        arguments += [] if cluster.log_format == "text" else ["--log-format", cluster.log_format]
        if waits is None:
            arguments += ["--connect", client]
            dialled = None
        else:
            arguments += ["--wait-at", str(waits)]
            dialled = waits._replace(host=dialled_at)
            waits = waits._replace(port=waits.port + 1)
        if metrics is not None and machine.metrics_token is not None:
            arguments += ["--metrics", str(metrics), "--metrics-token", machine.metrics_token]
            metrics = metrics._replace(port=metrics.port + 1)
        arguments += _cores(machine, _count(machine, program))
        if program is Program.SPLAT_SERVER:
            port = (advertised and advertised.port) or next(carried, 0)
            arguments += ["--listen", str(Address(listens, port))] if listens != LOOPBACK or port else []
            if advertised is not None:
                arguments += ["--advertise", _told(advertised)]
                advertised = advertised._replace(port=advertised.port and advertised.port + 1)
        elif machine.data_root:
            arguments += ["--data-root", machine.data_root]
        yield Ordered(ServerOrder(name, program, tuple(arguments)), number, dialled)


def _told(advertised: Address) -> str:
    """As a splat server takes it: without a port, which is its own then."""
    return str(advertised) if advertised.port else str(advertised).removesuffix(":0")


def _cores(machine: Machine, servers: int) -> list[str]:
    if machine.threads is not None:
        return ["--threads", str(machine.threads)]
    return [] if machine.launcher in ENGINES else ["--sharing", str(servers)]


def _data_links(cluster: Cluster, machine: Machine) -> str:
    """Where its splat servers take them: on loopback, which they do by themselves, if nobody comes from elsewhere."""
    others = [one for one in cluster.machines if not one.comes_by_loopback]
    is_local = machine.launcher == "local"
    if machine.hides_splat_servers or (is_local and not others):
        return LOOPBACK
    return everywhere_for(cluster, others) if is_local else _everywhere_on(machine)


def client_address(cluster: Cluster, machine: Machine, listen_port: int) -> str:
    """Where servers of this machine dial the client."""
    if machine.comes_by_loopback:
        return str(Address(LOOPBACK, listen_port))
    if cluster.client is not None:
        return cluster.client
    there = host_name(machine)
    if there is None:
        raise BadInput(f'{machine.title}: its servers must know where to dial; add client = "HOST:PORT", or listen')
    cure = 'add client = "HOST:PORT", as it is reached from there'
    try:
        _, own, reached = _route(there)
        if machine.launcher in ENGINES and reached == DEBIANS_OWN:
            own = _address_elsewhere() or own
    except OSError as error:
        raise BadInput(f"{machine.title}: no route to {there} is known ({error.strerror}); {cure}") from error
    if "%" in own:
        raise BadInput(f"{machine.title}: this machine's address towards {there}, {own}, holds on it alone; {cure}")
    return str(Address(own, listen_port))


def _address_elsewhere() -> str:
    """This machine's address towards others, "" if it has none."""
    try:
        return _route(NOBODY).own
    except OSError:
        return ""


def everywhere_for(cluster: Cluster, machines: Iterable[Machine]) -> str:
    """Where a client listens on every address for servers of these machines."""
    if cluster.client is not None:
        return _everywhere(parse_address(cluster.client).host)
    return EVERYWHERE_6 if EVERYWHERE_6 in map(_everywhere_on, machines) else EVERYWHERE


def _everywhere_on(machine: Machine) -> str:
    try:
        host = host_name(machine)
    except BadInput:  # told of this machine itself
        return EVERYWHERE
    return EVERYWHERE if host is None else _everywhere(host)


def _everywhere(host: str) -> str:
    """On every address of IPv4, and of IPv6 too if nothing else is known to lead to this host."""
    try:
        family = _route(host).family
    except OSError:  # it is known elsewhere alone
        return EVERYWHERE
    return EVERYWHERE_6 if family == socket.AF_INET6 else EVERYWHERE


class KnownRoute(NamedTuple):
    """From this machine to a host, each by its address."""

    family: socket.AddressFamily
    own: str
    reached: str


def _route(host: str) -> KnownRoute:
    """By IPv4 if that leads there. Raises OSError."""
    try:
        ways = socket.getaddrinfo(host, DISCARD_PORT, type=socket.SOCK_DGRAM)
    except UnicodeError as error:  # DNS has no such names
        raise socket.gaierror(socket.EAI_NONAME, "it is no name") from error
    failures = []
    for family, *_, place in sorted(ways, key=lambda way: way[0] != socket.AF_INET):
        try:
            with socket.socket(family, socket.SOCK_DGRAM) as asking:
                asking.connect(place)
                return KnownRoute(family, str(asking.getsockname()[0]), str(place[0]))
        except OSError as error:
            failures.append(error)
    raise failures[0]


def _reached_at(machine: Machine, waits: Address) -> str:
    """The host by which a client dials servers that wait here."""
    if waits.host not in (EVERYWHERE, EVERYWHERE_6):
        return waits.host
    if (advertised := machine.advertised_at) is not None:
        return advertised.host
    if machine.launcher == "local":
        return LOOPBACK
    return host_name(machine) or machine.title
