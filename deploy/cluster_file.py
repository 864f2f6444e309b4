"""The cluster file: which machines there are, how many servers each runs, and by what they are started."""

import re
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from volsplat.deploy.launcher_keys import DaskKeys, KubernetesKeys, SlurmKeys, SshKeys
from volsplat.deploy.server_command import first_word
from volsplat.program.command_lines import LONGEST_WAIT
from volsplat.protocol.messages.session_messages import LEAST_SILENCE, MOST_SILENCE
from volsplat.protocol.text.byte_sizes import bytes_from_option
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant
from volsplat.protocol.text.toml_tables import (
    Complaint,
    complaint_of,
    shown_place,
    shown_value,
    toml_tables,
    value_at,
)
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.encryption import Encryption

LauncherName = Literal["local", "ssh", "dask", "slurm", "kubernetes", "manual"]
LogFormat = Literal["text", "json"]
ENGINES = {"dask", "slurm", "kubernetes"}  # choose a place for each server, and give it cores of its own
BY_HAND = {"kubernetes", "manual"}  # people start and end their servers: no command can ask after these
Count = Annotated[int, Meta(ge=0, le=1000)]
Text = Annotated[str, Meta(min_length=1, max_length=4096, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
Name = Annotated[str, Meta(min_length=1, max_length=64, pattern=r"\A[A-Za-z0-9][A-Za-z0-9._-]*\Z")]


class Table(msgspec.Struct, frozen=True, kw_only=True, rename="kebab", forbid_unknown_fields=True):
    pass


class Machine(Table, frozen=True, kw_only=True):
    """One machine, or one engine's share of the servers."""

    launcher: LauncherName
    host: Text | None = None  # where it makes sense; as ssh knows it
    map_shade_servers: Count = 0
    splat_servers: Count = 0
    threads: Annotated[int, Meta(ge=1, le=1024)] | None = None  # of each server; absent: its cores shared out
    memory: Text | None = None  # of a prepared volume for each map/shade server, as "8G"; the least counts for all
    data_root: Text | None = None  # nothing outside is opened; a relative VOLUME lies below it
    command: Text = "volsplat"  # how volsplat is called there
    listen: Text | None = None  # servers wait here to be dialled, on consecutive ports; absent: they dial the client
    advertise: Text | None = None  # HOST or HOST:PORT of its splat servers for others; absent: by each one's route
    metrics: Text | None = None  # HOST:PORT where its first server hands out metrics, the others on the ports after it
    metrics_token: Text | None = None  # the file there with the token that whoever reads them shows
    ssh: SshKeys = SshKeys()
    dask: DaskKeys = DaskKeys()
    slurm: SlurmKeys = SlurmKeys()
    kubernetes: KubernetesKeys = KubernetesKeys()

    @property
    def title(self) -> str:
        """What its servers are named after."""
        return self.host or self.launcher

    @property
    def behind_tunnel(self) -> bool:
        """Whether ssh alone reaches it, and its servers nobody but by what ssh carries."""
        return self.launcher == "ssh" and self.ssh.tunnel

    @property
    def comes_by_loopback(self) -> bool:
        """Whether its servers dial their own loopback: the client's machine is theirs, or ssh carries what they say."""
        return self.launcher == "local" or self.behind_tunnel

    @property
    def hides_splat_servers(self) -> bool:
        """Whether servers elsewhere reach its splat servers by a tunnel alone."""
        return self.behind_tunnel and self.splat_servers > 0 and self.advertise is None

    @property
    def metrics_at(self) -> Address | None:
        """Of its first server."""
        return None if self.metrics is None else parse_address(self.metrics)

    @property
    def advertised_at(self) -> Address | None:
        """Of its first splat server; at port 0 of each one's own port."""
        return None if self.advertise is None else _advertised(self.advertise)

    @property
    def listens_at(self) -> Address | None:
        """Of its first server."""
        return None if self.listen is None else parse_address(self.listen)


class Cluster(Table, frozen=True, kw_only=True):
    """All of a cluster file."""

    name: Name
    machines: Annotated[tuple[Machine, ...], Meta(min_length=1, max_length=1000)]
    client: Text | None = None  # HOST:PORT where servers that dial in reach the client; absent: found by routes
    tls: bool = True
    # Seconds, after which a peer that says nothing is lost.
    silence: Annotated[float, Meta(ge=LEAST_SILENCE, le=MOST_SILENCE)] = 2.0
    keep: Annotated[float, Meta(gt=0, le=LONGEST_WAIT)] = 600.0  # seconds that servers stay without a client
    token_file: Text | None = None  # absent: `volsplat deploy up` makes one
    log_format: LogFormat = "text"  # of the servers' logs

    @property
    def map_shade_servers(self) -> int:
        return sum(machine.map_shade_servers for machine in self.machines)

    @property
    def memory_bytes(self) -> int | None:
        """That each map/shade server may hold: the least that any machine has; None where none says."""
        said = [bytes_from_option("memory", machine.memory) for machine in self.machines if machine.memory is not None]
        return min(said, default=None)

    @property
    def encryption(self) -> Encryption:
        return Encryption.of(None if self.tls else False)

    @property
    def splat_servers(self) -> int:
        return sum(machine.splat_servers for machine in self.machines)


def read_cluster(path: Path) -> Cluster:
    """The cluster in a TOML file. Raises BadInput, which names the key, the cause and the cure."""
    return cluster_from_toml(read_cluster_text(path), str(path))


def read_cluster_text(path: Path) -> str:
    try:
        if path.is_fifo():
            raise BadInput(f"{path}: is a pipe, but a cluster file is read more than once; write it into a file")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot read the cluster file: {error.strerror}; check its name") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: byte {error.start} is not UTF-8 text; a cluster file is TOML") from error


def cluster_from_toml(text: str, name: str) -> Cluster:
    """As read_cluster, from TOML text; `name` stands before every message."""
    given = toml_tables(text, name)
    try:
        cluster = msgspec.convert(given, Cluster)
    except msgspec.ValidationError as error:
        raise BadInput(_told(name, complaint_of(error), given)) from error
    _check(cluster, name)
    return cluster


def _check(cluster: Cluster, name: str) -> None:
    """What no type can say."""
    for number, machine in enumerate(cluster.machines):
        place = f"{name}: machines[{number}]"
        _checked(f"{place}.listen", machine.listen, parse_address)
        _checked(f"{place}.advertise", machine.advertise, _advertised)
        _checked(f"{place}.metrics", machine.metrics, parse_address)
        _checked(f"{place}.command", machine.command, first_word)
        _checked(f"{place}.memory", machine.memory, lambda text: bytes_from_option("memory", text))
        servers = machine.map_shade_servers + machine.splat_servers
        _check_ports(f"{place}.listen", machine.listens_at, servers)
        _check_ports(f"{place}.metrics", machine.metrics_at, servers)
        if (advertised := machine.advertised_at) is not None and advertised.port:
            _check_ports(f"{place}.advertise", advertised, machine.splat_servers)
        if (machine.metrics is None) != (machine.metrics_token is None):
            raise BadInput(f"{place}: metrics and metrics-token belong together; give both or none")
        if machine.listen is not None and machine.launcher in ENGINES and machine.host is None:
            raise BadInput(
                f'{place}.listen: {machine.launcher} chooses where servers run; add host = "NAME", or leave '
                "listen out: then they dial the client"
            )
        if machine.launcher == "ssh" and machine.host is None:
            raise BadInput(f'{place}.host: the launcher ssh needs to know where; add host = "NAME"')
        if machine.host is not None and (machine.host.startswith("-") or " " in machine.host):
            raise BadInput(
                f"{place}.host: {shown_value(machine.host)} is no name of a machine; give it as ssh knows it"
            )
        if servers == 0:
            raise BadInput(f"{place}: runs no server; give map-shade-servers or splat-servers, or leave it out")
    _check_tunnels(cluster, name)
    _checked(f"{name}: client", cluster.client, _place_to_dial)
    for kind, count in (("map-shade-servers", cluster.map_shade_servers), ("splat-servers", cluster.splat_servers)):
        if count == 0:
            raise BadInput(f"{name}: {kind}: no machine runs any, but one is needed at least; add {kind} = 1 to one")


def _check_tunnels(cluster: Cluster, name: str) -> None:
    """Who dials servers behind a tunnel must have one as well, or be on this machine, where all of them begin."""
    hidden = next((machine.title for machine in cluster.machines if machine.hides_splat_servers), None)
    for number, machine in enumerate(cluster.machines):
        if machine.behind_tunnel and machine.listen is not None:
            raise BadInput(
                f"{name}: machines[{number}].listen: its servers dial the client through the tunnel; leave listen out"
            )
        if hidden and machine.map_shade_servers and not machine.behind_tunnel and machine.launcher != "local":
            raise BadInput(
                f"{name}: machines[{number}]: its map/shade servers do not reach the splat servers of {hidden}, which "
                f"are behind a tunnel; give {hidden} advertise if there is a way, or this machine ssh.tunnel = true"
            )


def _check_ports(place: str, address: Address | None, servers: int) -> None:
    """Each of them takes one, from that of the address on."""
    if address is not None and not 0 < address.port <= 65536 - max(servers, 1):
        raise BadInput(f"{place}: port {address.port} leaves no room for {servers} servers; choose from 1024 on")


def _advertised(text: str) -> Address:
    """Raises BadInput."""
    with suppress(ValueError):
        return Address(str(ip_address(text.removeprefix("[").removesuffix("]"))), 0)
    if ":" in text:
        return parse_address(text)
    if not re.fullmatch(r"[^\s/@]+", text):
        raise BadInput(f"{text!r} is not an address; write HOST, or HOST:PORT")
    return Address(text, 0)


def _place_to_dial(text: str) -> None:
    if parse_address(text).port == 0:
        raise BadInput(f"{text!r}: servers cannot dial port 0; choose one from 1024 on")


def _checked(place: str, text: str | None, parse: Callable[[str], object]) -> None:
    if text is not None:
        try:
            parse(text)
        except BadInput as error:
            raise BadInput(f"{place}: {error}") from error


def _told(name: str, complaint: Complaint, given: dict[str, Any]) -> str:
    what, place = complaint
    if (key := re.search(r"(unknown field|missing required field) `(.*)`", what)) is not None:
        lies = f"{place}.{key[2]}" if place else key[2]
        if key[1].startswith("missing"):
            return f"{name}: {lies}: this key is missing; add it"
        return f"{name}: {shown_place(lies)}: unknown key; {_suggestion(key[2], place)}"
    return f"{name}: {shown_place(place) or 'the file'}: {_cause(what, place, value_at(given, place))}"


def _cause(what: str, place: str, value: Any) -> str:
    if what.startswith("Invalid enum value"):
        choices = get_args(LauncherName if place.endswith("launcher") else LogFormat)
        return f"{shown_value(value)} is none; choose from {', '.join(choices)}"
    return f"{shown_value(value)} cannot be used: {what[0].lower()}{what[1:]}; give another"


def _suggestion(key: str, place: str) -> str:
    known = _table_at(place).__struct_encode_fields__
    return meant(key, known, f"{shown_place(place) or 'a cluster file'} has {', '.join(known)}")


def _table_at(place: str) -> type[msgspec.Struct]:
    tables: dict[str, type[msgspec.Struct]] = {
        "ssh": SshKeys, "dask": DaskKeys, "slurm": SlurmKeys, "kubernetes": KubernetesKeys
    }  # fmt: skip
    return tables.get(place.rpartition(".")[2], Machine if place else Cluster)
