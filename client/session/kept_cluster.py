"""A cluster that one client has, for one session or several in turn: brought up if it is not, and ended after them."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from pathlib import Path

from volsplat.client.caller.own_process import OwnProcess
from volsplat.deploy.cluster.cluster_use import ClusterUse
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterBusy, ClusterState, MachinesFailed
from volsplat.protocol.text.errors import VolsplatError


class KeptCluster:
    """No other client uses it until it is closed. Its sessions are opened one after another."""

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
            if self._as_it_is() is None:
                self._bring_up()
        except BaseException:
            self._use.end()
            raise

    @property
    def running(self) -> RunningCluster:
        return self._running

    def state(self) -> ClusterState:
        """What the next session finds: servers may have been started anew in the one before. Raises BadInput."""
        state = self._running.state()
        if state is not None and state.can_draw:  # what is missing of it has been told
            return state
        return self._as_it_is() or self._bring_up()

    def close(self) -> None:
        """Bring the cluster down if it was brought up for this client, and let others use it."""
        try:
            if self._brought_up:
                self._down()
        finally:
            if self._opened_by.is_here:  # a process that was forked has the same lock
                self._use.end()

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
