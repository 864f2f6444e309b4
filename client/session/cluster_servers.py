"""The servers of a cluster in a session: those that wait are dialled, lost ones found again or started anew."""

import atexit
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from volsplat.client.caller.own_process import OwnProcess
from volsplat.client.session.server_links import ServerLinks
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterState, KnownServer
from volsplat.deploy.launchers.launcher import ServerState
from volsplat.deploy.restart_limit import RestartLimit
from volsplat.deploy.server_command import Program
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.text.errors import BadInput, TurnedAway, VolsplatError
from volsplat.protocol.wire.addresses import Address, parse_address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.tokens import Token

MISSING_SECONDS = 60.0  # after which a server that has not joined is waited for no more, not counted while it is queued
UNHEARD_SECONDS = 5.0  # likewise, after which others draw without one whose machine cannot be asked about it …
JOINING_SECONDS = 20.0  # … or that runs, and should have dialled
FROZEN_SECONDS = 2.0  # likewise, after which one that had joined is started anew though it runs: it would dial at once
LOOK_SECONDS = 2.0  # between two looks at servers that are missing
CALL_SECONDS = 1e9  # a caller tries until it is told to stop
ASKED_WHERE_THEY_RUN = ("local", "ssh")  # launchers; others ask an engine of its servers, or nobody


class Absent(NamedTuple):
    """Servers that are missing, and will be for a while."""

    unheard: set[str]  # they are not heard of, and it is not known why
    unable: set[str]  # end again and again as soon as they are started


class ClusterServers:
    """Joins them to a session until it is closed."""

    def __init__(self, path: Path, report: Callable[[str], None]) -> None:
        """Brings the cluster up if it is not. `report` gets lines of progress. Raises BadInput."""
        self._running, self._report = RunningCluster(path), report
        self._opened_by = OwnProcess()
        self.cluster = self._running.cluster
        self._missing_since: dict[str, float] = {}  # time.monotonic(); the watching thread's
        self._restarts = defaultdict[str, RestartLimit](RestartLimit)  # likewise
        state = self._running.state()
        self._brought_up = state is None
        if self._brought_up:
            atexit.register(self._down)  # wherever Ctrl-C ends what follows
        self._state = self._bring_up() if state is None else self._with_both_kinds(state)
        self._known = {one.started.name: one for one in self._state.servers}
        self._lock = threading.Lock()  # guards what follows
        self._why: dict[str, str] = {}  # each is not there
        self._closed = threading.Event()
        self._is_our_turn = threading.Event()  # to dial all servers that wait
        self._watching: threading.Thread | None = None
        self._tunnels: Tunnels | None = None

    def _bring_up(self) -> ClusterState:
        try:
            return self._running.up(self._report)
        except BaseException:
            self._down()
            raise

    def _with_both_kinds(self, state: ClusterState) -> ClusterState:
        """Without machines that failed at `deploy up`; if a kind is missing, all that failed are tried again."""
        if not _has_both_kinds(state):
            try:
                return self._running.up(self._report)
            except BadInput as error:
                now = self._running.state()
                if now is None or not _has_both_kinds(now):
                    raise
                self._report(str(error))
                return now
        for title, line in self._running.never_started(state):
            self._report(f"{title}: {line}")
        return state

    def _down(self) -> None:
        if not self._opened_by.is_here:  # a process that was forked ends
            return
        self._running.down(self._report)
        atexit.unregister(self._down)

    @property
    def token(self) -> Token:
        return self._running.token

    @property
    def listens_at(self) -> Address:
        return self._running.listens_at(self._state)

    def count(self, program: Program) -> int:
        """How many were started."""
        return sum(one.program is program for one in self._state.servers)

    def volume(self, name: str) -> str:
        return self._running.volume(name)

    def join(self, links: ServerLinks) -> None:
        """Take the servers into a session, which listens."""
        self._tunnels = self._running.tunnels(self._state, self._report)
        waiting = sorted((one for one in self._state.servers if one.wait_at), key=lambda one: one.wait_at)
        for one in waiting:
            begin = self._call_first if one is waiting[0] else self._call_in_turn
            threading.Thread(target=begin, args=(one, links), name=f"call {one.started.name}", daemon=True).start()
        self._watching = threading.Thread(target=self._watch, args=(links,), name="watch the cluster", daemon=True)
        self._watching.start()

    @contextmanager
    def beginning(self) -> Iterator[None]:
        """While the session begins to listen. Raises BadInput if another client of this machine does in its place."""
        try:
            yield
        except BaseException as error:
            self.release()
            if isinstance(error, BadInput):
                raise BadInput(
                    f"the cluster {self.cluster.name} serves another client of this machine: {error}"
                ) from error
            raise

    def close(self) -> None:
        """The session ends: look for no more servers."""
        self._closed.set()
        self._is_our_turn.set()

    def release(self) -> None:
        """The session has ended: bring the cluster down if it was brought up for it.

        Waits until a server that is being started anew is: nobody would know of it.
        """
        if self._watching is not None:
            self._watching.join()
        if self._tunnels is not None:
            self._tunnels.close()
        if self._brought_up:
            self._down()

    # -- servers that wait are dialled

    def _call_first(self, one: KnownServer, links: ServerLinks) -> None:
        """The same server for every client: who has it dials the others, so that no two clients wait for each other."""
        try:
            self._call(one, links)
        finally:
            self._is_our_turn.set()

    def _call_in_turn(self, one: KnownServer, links: ServerLinks) -> None:
        self._is_our_turn.wait()
        self._call(one, links)

    def _call(self, one: KnownServer, links: ServerLinks) -> None:
        name, address = one.started.name, parse_address(one.wait_at)
        while not self._closed.is_set():
            try:
                connection = self._connected(name, address, links)
            except VolsplatError as error:
                self._note(name, str(error))
                self._closed.wait(LOOK_SECONDS)
                continue
            with self._lock:
                self._why.pop(name, None)
            self._is_our_turn.set()
            links.serve(connection)

    def _failed(self, error: VolsplatError) -> None:
        """Of a try to dial: only that of the first server counts, since others are dialled once it is our turn."""
        if not isinstance(error, TurnedAway):  # it decides nothing
            self._is_our_turn.set()

    def _connected(self, name: str, address: Address, links: ServerLinks) -> Connection:
        return call(
            address,
            name,
            links.accepter,
            encryption=links.encryption,
            patience=CALL_SECONDS,
            report=lambda line: self._note(name, line),
            given_up=self._closed.is_set,
            failed=self._failed,
        )

    def _note(self, name: str, line: str) -> None:
        with self._lock:
            known = self._why.get(name) == line
            self._why[name] = line
        if not known and not self._closed.is_set():
            self._report(line)

    # -- those that are missing

    def _watch(self, links: ServerLinks) -> None:
        """Start those anew that have ended or are frozen; say of those that do not come that nobody waits for them."""
        began, seen = time.monotonic(), set[str]()
        while self._looks_again(links):
            missing = self._missing(links)
            seen |= self._known.keys() - missing
            self._missing_since = {name: self._missing_since.get(name, began) for name in missing}
            absent = self._looked_after(missing, seen)
            cause = f"servers of {self.cluster.name} are missing: {self._reasons(missing)}"
            all_are_absent = set(missing) <= absent.unheard | absent.unable
            if self._missing_for(MISSING_SECONDS) or (missing and absent.unable.issuperset(missing)):
                links.give_up(cause)
            elif missing and all_are_absent:
                links.go_without(cause)
            began = time.monotonic()

    def _looks_again(self, links: ServerLinks) -> bool:
        """Whether the session goes on, as soon as a server is lost or a while later."""
        links.wait_for_a_loss(LOOK_SECONDS)
        return not self._closed.is_set()

    def _missing_for(self, seconds: float) -> set[str]:
        now = time.monotonic()
        return {name for name, since in self._missing_since.items() if now - since > seconds}

    def _missing(self, links: ServerLinks) -> list[str]:
        there = links.present()
        return [name for name, one in self._known.items() if not any(map(one.is_process, there))]

    def _looked_after(self, missing: list[str], seen: set[str]) -> Absent:
        """What cannot be done about those that are missing."""
        absent = Absent(set(), set())
        try:
            if missing:
                self._look_after(missing, seen, absent)
        except VolsplatError as error:
            self._report(str(error))
        return absent

    def _look_after(self, missing: list[str], seen: set[str], absent: Absent) -> None:
        """Those that have ended are started anew, and those that were `seen` in the session and do not come again."""
        ended = list[str]()
        frozen = {
            name for name in self._missing_for(FROZEN_SECONDS) & seen if self._reachable_for(FROZEN_SECONDS, name)
        }
        statuses = self._running.statuses()  # takes a while where a machine does not answer
        unheard = self._missing_for(UNHEARD_SECONDS) & self._asked_where_they_run
        late = {name for name in self._missing_for(JOINING_SECONDS) if not self._known[name].wait_at}
        for one, said in statuses:
            name = one.started.name
            if name not in missing:
                continue
            if name in {ServerState.UNKNOWN: unheard, ServerState.RUNNING: late}.get(said.state, ()):
                absent.unheard.add(name)
            if said.state is ServerState.ENDED:
                ended.append(name)
                self._note(name, f"{name} has ended: {said.reason}")
            elif said.state is ServerState.QUEUED:
                self._missing_since[name] = time.monotonic()
                self._note(name, f"{name} is queued: {said.reason}")
            elif said.state is ServerState.RUNNING and name in frozen:
                ended.append(name)
                self._note(name, f"{name} runs and does not join again; another one is started in its place")
            elif not one.wait_at and not self._cut_off(name):  # else whoever dials it knows better, or its tunnel
                self._note(name, f"{name} has not joined yet" + (f": {said.reason}" if said.reason else ""))
        again = [name for name in ended if self._restarts[name].may_restart()]
        absent.unable.update(set(ended).difference(again))
        if again:
            seen.difference_update(again)
            try:
                self._running.up(self._report, anew=again)
            finally:
                if (state := self._running.state()) is not None:
                    self._known = {one.started.name: one for one in state.servers}

    @property
    def _asked_where_they_run(self) -> set[str]:
        """Those whose own machine is asked: if it does not answer, they may be gone with it."""
        machines = self.cluster.machines
        return {name for name, one in self._known.items() if machines[one.machine].launcher in ASKED_WHERE_THEY_RUN}

    def _reachable_for(self, seconds: float, name: str) -> bool:
        return self._tunnels is None or self._tunnels.open_for(self._known[name].machine) > seconds

    def _cut_off(self, name: str) -> str:
        """Why its tunnel is not open, if it needs one."""
        return "" if self._tunnels is None else self._tunnels.failure(self._known[name].machine)

    def _reasons(self, missing: list[str]) -> str:
        with self._lock:
            known = [self._cut_off(name) or self._why.get(name, "") for name in missing]
        reasons = [reason for reason in known if reason] or [f"{name} has not joined" for name in missing]
        return "; ".join(dict.fromkeys(reasons))


def _has_both_kinds(state: ClusterState) -> bool:
    return {one.program for one in state.servers} == set(Program)
