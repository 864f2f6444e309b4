"""The servers of a cluster in a session: brought up if they are not, joined to it, and let go at its end."""

import atexit
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.client.caller.own_process import OwnProcess
from volsplat.client.session.cluster_calls import ClusterCalls
from volsplat.client.session.cluster_watch import ClusterWatch
from volsplat.client.session.missing_reasons import MissingReasons
from volsplat.client.session.server_links import ServerLinks
from volsplat.deploy.cluster.cluster_use import ClusterUse
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterBusy, ClusterState, MachinesFailed
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.tokens import Token


class ClusterServers:
    """Joins them to a session until it is closed."""

    here = False
    replaced = True

    def __init__(self, path: Path, report: Callable[[str], None], tell_missing: Callable[[str], None]) -> None:
        """Waits until no other client uses the cluster, and brings it up if it is not. Raises BadInput.

        `report` gets lines of progress, `tell_missing` one for each thing that failed and is gone on without.
        """
        self._running, self._report, self._tell_missing = RunningCluster(path), report, tell_missing
        self._opened_by = OwnProcess()
        self._brought_up = False
        self._use = ClusterUse(self._running.folder)
        self._use.take(report)
        try:
            self._state = self._as_it_is() or self._bring_up()
        except BaseException:
            self._use.end()
            raise
        self._reasons = MissingReasons(report)
        self._tunnels: Tunnels | None = None
        self._calls: ClusterCalls | None = None
        self._watch: ClusterWatch | None = None

    def _as_it_is(self) -> ClusterState | None:
        """None where it is not up."""
        state = self._running.state()
        return None if state is None else self._with_both_kinds(state)

    def _bring_up(self) -> ClusterState:
        self._brought_up = True
        atexit.register(self._down_at_exit)  # wherever Ctrl-C ends what follows
        try:
            return self._up_as_far_as_it_draws()
        except ClusterBusy:  # by somebody else, who has it then
            atexit.unregister(self._down_at_exit)
            raise
        except BaseException:
            self._down()
            raise

    def _with_both_kinds(self, state: ClusterState) -> ClusterState:
        """Without machines that failed at `deploy up`; if a kind is missing, all that failed are tried again."""
        if not state.can_draw:
            return self._up_as_far_as_it_draws()
        for title, line in self._running.never_started(state):
            self._tell_missing(f"{title}: {line}")
        return state

    def _up_as_far_as_it_draws(self) -> ClusterState:
        """Without machines that fail, if there are both kinds of server. Raises BadInput, which names them, if not."""
        try:
            return self._running.up(self._report)
        except MachinesFailed as error:
            if not error.state.can_draw:
                raise
            self._tell_missing(str(error))
            return error.state

    def _down(self) -> None:
        if not self._opened_by.is_here:  # a process that was forked ends
            return
        try:
            self._running.down(self._report)
        except VolsplatError:  # another try would end alike, but after Ctrl-C it need not
            atexit.unregister(self._down_at_exit)
            raise
        atexit.unregister(self._down_at_exit)

    def _down_at_exit(self) -> None:
        try:
            self._down()
        except VolsplatError as error:
            self._report(str(error))

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
        """The session ends: look for no more servers."""
        self._reasons.close()
        if self._calls is not None:
            self._calls.close()
        if self._watch is not None:
            self._watch.close()

    def release(self) -> None:
        """The session has ended: bring the cluster down if it was brought up for it, and let other clients use it."""
        try:
            if self._watch is not None:
                self._watch.join()
            if self._tunnels is not None:
                self._tunnels.close()
            if self._brought_up:
                self._down()
        finally:
            if self._opened_by.is_here:  # a process that was forked has the same lock
                self._use.end()
