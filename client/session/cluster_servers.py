"""The servers of a cluster in a session: joined to it, and let go at its end."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from volsplat.client.session.cluster_calls import ClusterCalls
from volsplat.client.session.cluster_watch import ClusterWatch
from volsplat.client.session.kept_cluster import KeptCluster
from volsplat.client.session.links.server_links import ServerLinks
from volsplat.client.session.missing_reasons import MissingReasons
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.tokens import Token


class ClusterServers:
    """Joins them to a session until it has failed or is closed."""

    here = False
    replaced = True

    def __init__(self, kept: KeptCluster, report: Callable[[str], None], *, lasts: bool) -> None:
        """The cluster is closed with the session, unless it `lasts`. Raises BadInput.

        `report` gets lines of progress.
        """
        self._kept, self._lasts, self._report = kept, lasts, report
        self._running = kept.running
        try:
            self._state = kept.state()
        except BaseException:
            self._let_go()
            raise
        self._reasons = MissingReasons(report)
        self._tunnels: Tunnels | None = None
        self._calls: ClusterCalls | None = None
        self._watch: ClusterWatch | None = None
        self._closed = False

    @property
    def workers(self) -> int:
        return self._started(Program.MAPSHADE_SERVER)

    @property
    def splat_servers(self) -> int:
        return self._started(Program.SPLAT_SERVER)

    def _started(self, program: Program) -> int:
        return sum(one.program is program for one in self._state.servers)

    @property
    def listens_at(self) -> Address:
        return self._running.listens_at(self._state)

    @property
    def token(self) -> Token:
        return self._running.token

    @property
    def silence(self) -> float:
        return self._running.cluster.silence

    @property
    def encryption(self) -> Encryption:
        return self._running.cluster.encryption

    @property
    def memory(self) -> int | None:
        return self._running.cluster.memory_bytes

    def volume(self, name: str) -> str:
        return self._running.volume(name)

    def join(self, links: ServerLinks) -> None:
        """Take the servers into a session, which listens."""
        self._tunnels = self._running.tunnels(self._state, self._report)
        self._calls = ClusterCalls(self._state.servers, links, self._reasons)
        self._watch = ClusterWatch(self._running, self._state, self._tunnels, links, self._reasons, self._report)
        self._calls.begin()
        self._watch.begin()
        if self._closed:  # the session has failed meanwhile
            self.close()

    @contextmanager
    def beginning(self) -> Iterator[None]:
        """While the session begins to listen. Raises BadInput if another client of this machine does in its place."""
        try:
            yield
        except BaseException as error:
            self.release()
            if isinstance(error, BadInput):
                raise self._running.cannot_listen(error) from error
            raise

    def close(self) -> None:
        """Look for no more servers."""
        self._closed = True
        self._reasons.close()
        if self._calls is not None:
            self._calls.close()
        if self._watch is not None:
            self._watch.close()

    def release(self) -> None:
        """The session has ended, and with it what was begun for it."""
        try:
            if self._watch is not None:
                self._watch.join()
            if self._tunnels is not None:
                self._tunnels.close()
        finally:
            self._let_go()

    def _let_go(self) -> None:
        if not self._lasts:
            self._kept.close()
