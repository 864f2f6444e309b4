"""Watches which servers of a cluster are missing: those that have ended or are frozen are started anew.

Of those that do not come, the session hears that nobody waits for them.
"""

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Collection
from typing import NamedTuple

from volsplat.client.session.links.server_links import ServerLinks
from volsplat.client.session.missing_reasons import MissingReasons
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterState, KnownServer
from volsplat.deploy.launchers.launcher import Said, ServerState
from volsplat.deploy.restart_limit import RestartLimit
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.text.printable import one_line

MISSING_SECONDS = 60.0  # after which a server that has not joined is waited for no more, not counted while it is queued
UNHEARD_SECONDS = 5.0  # after which others draw without one whose machine cannot be asked about it …
JOINING_SECONDS = 20.0  # … or that runs, and should have dialled
FROZEN_SECONDS = 2.0  # after which one that had joined is started anew though it runs: it would dial at once
LOOK_SECONDS = 2.0  # between two looks at servers that are missing
ASKED_WHERE_THEY_RUN = ("local", "ssh")  # launchers; others ask an engine of its servers, or nobody


class Looked(NamedTuple):
    """What was found of servers that are missing."""

    ended: list[str]  # or frozen: others are to be started in their place
    unheard: set[str]  # they are not heard of, and it is not known why


class ClusterWatch:
    """A thread watches from begin() until it is closed."""

    def __init__(
        self,
        running: RunningCluster,
        state: ClusterState,
        tunnels: Tunnels,
        links: ServerLinks,
        reasons: MissingReasons,
        report: Callable[[str], None],
    ) -> None:
        self._running, self._tunnels, self._links = running, tunnels, links
        self._reasons, self._report = reasons, report
        self._state = state  # as of the beginning
        self._known = {one.started.name: one for one in state.servers}
        self._missing_since: dict[str, float] = {}  # time.monotonic()
        self._restarts = defaultdict[str, RestartLimit](RestartLimit)
        self._told = ""  # the last line on what went wrong
        self._closed = threading.Event()
        self._starting = threading.Lock()  # held while servers are started anew

    def begin(self) -> None:
        threading.Thread(target=self._watch, name="watch the cluster", daemon=True).start()

    def close(self) -> None:
        """No other server is started anew."""
        self._closed.set()

    def join(self) -> None:
        """Once closed, wait until a server that is being started anew is: nobody would know of it.

        A machine that is being asked is not waited for: one that hangs answers after a minute, or never.
        """
        with self._starting:
            pass

    def _watch(self) -> None:
        began, seen = time.monotonic(), set[str]()
        while self._looks_again():
            missing = self._missing()
            seen |= self._known.keys() - missing
            self._missing_since = {name: self._missing_since.get(name, began) for name in missing}
            self._look_after(missing, seen)
            began = time.monotonic()

    def _looks_again(self) -> bool:
        """Whether the session goes on, as soon as a server is lost or a while later."""
        self._links.wait_for_a_loss(LOOK_SECONDS)
        return not self._closed.is_set()

    def _missing(self) -> list[str]:
        there = self._links.present()
        return [name for name, one in self._known.items() if not any(map(one.is_process, there))]

    def _missing_for(self, seconds: float) -> set[str]:
        now = time.monotonic()
        return {name for name, since in self._missing_since.items() if now - since > seconds}

    def _look_after(self, missing: Collection[str], seen: set[str]) -> None:
        """Do what can be done about them, and say of the rest that they are waited for no more.

        Those that were `seen` in the session should dial again at once; others that are started anew were not.
        """
        looked = self._looked(missing, seen) if missing else Looked([], set())
        if self._closed.is_set():
            return
        again = [name for name in looked.ended if self._restarts[name].may_restart()]
        if again:
            seen.difference_update(again)
            self._start_anew(again)
        unable = set(looked.ended).difference(again)  # they end again and again as soon as they are started
        cause = f"servers of {self._running.cluster.name} are missing: {self._told_reasons(missing)}"
        if self._missing_for(MISSING_SECONDS) or (missing and unable.issuperset(missing)):
            self._links.give_up(cause)
        elif missing and (looked.unheard | unable).issuperset(missing):
            self._links.go_without(cause)

    def _looked(self, missing: Collection[str], seen: set[str]) -> Looked:
        frozen = {
            name for name in self._missing_for(FROZEN_SECONDS) & seen if self._reachable_for(FROZEN_SECONDS, name)
        }
        statuses = self._statuses()  # takes a while where a machine does not answer
        unheard = self._missing_for(UNHEARD_SECONDS) & self._asked_where_they_run
        late = {name for name in self._missing_for(JOINING_SECONDS) if not self._known[name].wait_at}
        due = {ServerState.UNKNOWN: unheard, ServerState.RUNNING: late}
        looked = Looked([], set())
        for one, said in statuses:
            name = one.started.name
            if name not in missing:
                continue
            if name in due.get(said.state, ()):
                looked.unheard.add(name)
            if self._has_ended(one, said, name in frozen):
                looked.ended.append(name)
        return looked

    def _statuses(self) -> list[tuple[KnownServer, Said]]:
        try:
            return self._running.statuses()
        except Exception as error:
            self._tell(error)
            return []

    def _tell(self, error: Exception) -> None:
        """Once of the same. One of another kind than ours ends no watch either: nobody would give up, or be started."""
        line = str(error) if isinstance(error, VolsplatError) else one_line(f"{type(error).__name__}: {error}")
        if line != self._told and not self._closed.is_set():
            self._told = line
            self._report(line)

    def _has_ended(self, one: KnownServer, said: Said, is_frozen: bool) -> bool:
        """Whether another is to be started in its place. Notes why it is missing."""
        name = one.started.name
        if said.state is ServerState.ENDED:
            self._reasons.note(name, f"{name} has ended: {said.reason}")
            return True
        if said.state is ServerState.QUEUED:
            self._missing_since[name] = time.monotonic()
            self._reasons.note(name, f"{name} is queued: {said.reason}")
        elif said.state is ServerState.RUNNING and is_frozen:
            self._reasons.note(name, f"{name} runs and does not join again; another one is started in its place")
            return True
        elif not one.wait_at and not self._cut_off(name):  # else whoever dials it knows better, or its tunnel
            self._reasons.note(name, f"{name} has not joined yet" + (f": {said.reason}" if said.reason else ""))
        return False

    def _start_anew(self, names: Collection[str]) -> None:
        with self._starting:
            if self._closed.is_set():
                return
            try:
                try:
                    self._running.up_anew(self._state, names, self._report)
                finally:
                    state = self._running.state()
                    if state is not None and state.mark == self._state.mark:
                        self._known = {one.started.name: one for one in state.servers}
            except Exception as error:
                self._tell(error)

    @property
    def _asked_where_they_run(self) -> set[str]:
        """Those whose own machine is asked: if it does not answer, they may be gone with it."""
        machines = self._running.cluster.machines
        return {name for name, one in self._known.items() if machines[one.machine].launcher in ASKED_WHERE_THEY_RUN}

    def _reachable_for(self, seconds: float, name: str) -> bool:
        return self._tunnels.open_for(self._known[name].machine) > seconds

    def _cut_off(self, name: str) -> str:
        """Why its tunnel is not open, if it needs one."""
        return self._tunnels.failure(self._known[name].machine)

    def _told_reasons(self, missing: Collection[str]) -> str:
        known = [self._cut_off(name) or self._reasons.get(name) for name in missing]
        reasons = [reason for reason in known if reason] or [f"{name} has not joined" for name in missing]
        return "; ".join(dict.fromkeys(reasons))
