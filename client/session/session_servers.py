"""Where the servers of a session come from: started on this machine, started by people, or a cluster's."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from volsplat.client.caller.arguments import checked_address, checked_count, checked_number
from volsplat.client.session.cluster_servers import ClusterServers
from volsplat.client.session.kept_cluster import KeptCluster
from volsplat.client.session.links.server_links import ServerLinks
from volsplat.program.this_machine import check_server_count, usable_cores, usual_servers
from volsplat.protocol.description.volume_name import absolute_name
from volsplat.protocol.messages.session_messages import LEAST_SILENCE, MOST_SILENCE
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token, new_token

ANY_LOOPBACK_PORT = Address(LOOPBACK, 0)


class SessionServers(Protocol):
    """What a session asks of them."""

    @property
    def workers(self) -> int: ...

    @property
    def splat_servers(self) -> int: ...

    @property
    def listens_at(self) -> Address:
        """Where the session listens for them."""

    @property
    def token(self) -> Token: ...

    @property
    def silence(self) -> float:
        """Seconds after which one that says nothing is lost."""

    @property
    def encryption(self) -> Encryption: ...

    @property
    def memory(self) -> int | None:
        """Bytes of a prepared volume that each may hold, unless the session says so."""

    @property
    def here(self) -> bool:
        """Whether they see this machine's files by the names that they have here."""

    @property
    def replaced(self) -> bool:
        """Whether others than the session start them again."""

    def beginning(self) -> AbstractContextManager[None]:
        """While the session begins to listen."""

    def join(self, links: ServerLinks) -> None:
        """Have them join."""

    def volume(self, name: str) -> str:
        """The name of a file or folder as it is told to them."""

    def close(self) -> None:
        """The session ends, or has failed: none is looked for any more. Any thread may call it, more than once."""

    def release(self) -> None:
        """The session has ended."""


@dataclass(frozen=True)
class StartedHere:
    """What servers that the session starts on this machine may use."""

    threads: int  # which they share out
    data_root: str | None  # folder outside of which map/shade servers read nothing


@dataclass(frozen=True)
class JoiningServers:
    """The session starts them on this machine, or people do so anywhere, and they join."""

    workers: int
    splat_servers: int
    listens_at: Address
    token: Token
    silence: float
    encryption: Encryption
    started: StartedHere | None  # None: people start them

    memory = None
    replaced = False

    @property
    def here(self) -> bool:
        return self.started is not None

    def beginning(self) -> AbstractContextManager[None]:
        return nullcontext()

    def join(self, links: ServerLinks) -> None:
        if self.started is not None:
            links.start(self.workers, self.splat_servers, self.started.threads, self.started.data_root)

    def volume(self, name: str) -> str:
        return absolute_name(name) if self.here else name

    def close(self) -> None:
        """They end with their links."""

    def release(self) -> None:
        """Nothing else is held for them."""


def asked_servers(
    *,
    workers: int | None,
    splat_servers: int | None,
    threads: int | None,
    listen: Address | str | None,
    spawn: bool,
    token: Token | None,
    silence: float | None,
    tls: bool | None,
    cluster: str | Path | KeptCluster | None,
    data_root: str | Path | None,
    report: Callable[[str], None],
    tell_missing: Callable[[str], None],
) -> SessionServers:
    """Those that a script asks a session for. Raises BadInput for what has no effect there, as for what is no number.

    Brings the cluster up if it is not. `report` gets lines of progress, `tell_missing` those of its machines that fail.
    """
    if cluster is not None:
        given = {"listen": listen, "token": token, "silence": silence, "tls": tls, "workers": workers}
        _refuse(given | {"splat_servers": splat_servers}, "the cluster file says this of its servers")
    if cluster is not None or not spawn:
        _refuse({"threads": threads, "data_root": data_root}, "this session starts no servers that it would hold for")
    if cluster is not None:
        if isinstance(cluster, KeptCluster):
            return ClusterServers(cluster, report, lasts=True)
        return ClusterServers(KeptCluster(Path(cluster), report, tell_missing), report, lasts=False)
    workers = usual_servers() if workers is None else checked_count(workers, "workers")
    splat_servers = 1 if splat_servers is None else checked_count(splat_servers, "splat_servers")
    started = None
    if spawn:
        check_server_count(workers + splat_servers)
        threads = usable_cores() if threads is None else checked_count(threads, "threads")
        started = StartedHere(threads, None if data_root is None else str(data_root))
    silence = SILENCE_SECONDS if silence is None else checked_number(silence, "silence", least=LEAST_SILENCE)
    return JoiningServers(
        workers,
        splat_servers,
        ANY_LOOPBACK_PORT if listen is None else checked_address(listen, "listen"),
        token or new_token(),
        min(silence, MOST_SILENCE),
        Encryption.of(tls),
        started,
    )


def _refuse(given: Mapping[str, object], why: str) -> None:
    names = [name for name, value in given.items() if value is not None]
    if names:
        raise BadInput(f"{why}; leave out {' and '.join(names)}")
