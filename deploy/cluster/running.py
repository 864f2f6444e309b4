"""A cluster brought up, asked after and brought down, machine by machine, all machines at once."""

import math
import socket
import threading
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import Future, wait
from contextlib import ExitStack, suppress
from pathlib import Path
from random import SystemRandom
from secrets import token_hex
from typing import NamedTuple, TypeVar

import msgspec

from volsplat.deploy.cluster.lasting_clock import Moment
from volsplat.deploy.cluster.orders import everywhere_for, orders_of, wanted_servers
from volsplat.deploy.cluster.state import ClusterState, KnownServer, MachinesFailed, StateFolder
from volsplat.deploy.cluster_file import BY_HAND, Cluster, cluster_from_toml, read_cluster_text
from volsplat.deploy.home_path import home_path
from volsplat.deploy.launchers.launcher import Launcher, Report, Said, Secrets, ServerState, StartedServer
from volsplat.deploy.launchers.table import cancelling, launcher_of
from volsplat.deploy.tunnels.ports import last_port
from volsplat.deploy.tunnels.tunnels import Tunnels
from volsplat.protocol.description.volume_name import absolute_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.tokens import Token

Result = TypeVar("Result")
MOST_AT_ONCE = 32  # machines
BELOW_CONNECTIONS = 16384, 32768  # ports; Linux gives those above to connections, before a client comes to listen


class Failed(NamedTuple):
    """What went wrong with a machine."""

    reason: str


class RunningCluster:
    """What `volsplat deploy` does to the cluster of a file."""

    def __init__(self, path: Path) -> None:
        """Raises BadInput for a file that cannot be used."""
        self.path = path
        self._text = read_cluster_text(path)
        self.cluster = cluster_from_toml(self._text, str(path))
        self.folder = StateFolder(self.cluster.name)
        self.unheard: dict[str, str] = {}  # servers whose machine did not answer the last up(), by name, and why

    @property
    def token(self) -> Token:
        return self.folder.token(self.token_file)

    @property
    def token_file(self) -> Path:
        """A relative one lies beside the cluster file. Raises BadInput."""
        given = self.cluster.token_file
        return self.folder.own_token_file if given is None else self.path.absolute().parent / home_path(given)

    def listens_at(self, state: ClusterState) -> Address:
        """Where a client listens: everywhere if servers of other machines dial in."""
        dial_in = {one.machine for one in state.servers if not one.wait_at}
        if not dial_in:
            return Address(LOOPBACK, 0)
        machines = [self.cluster.machines[number] for number in dial_in]
        elsewhere = [machine for machine in machines if not machine.comes_by_loopback]
        return Address(everywhere_for(self.cluster, elsewhere) if elsewhere else LOOPBACK, state.listen_port)

    def cannot_listen(self, error: BadInput) -> BadInput:
        """What a client is told that has no port for the servers that dial in."""
        problem, _, _ = str(error).partition("; ")
        other = (
            f"bring the cluster down and up again ({self.path}), which chooses another port"
            if self.cluster.client is None
            else f"give client another port in {self.path}"
        )
        return BadInput(
            f"{problem}: the cluster {self.cluster.name} serves another client of this machine, or another program has "
            f"its port; end that one, or {other}"
        )

    def tunnels(self, state: ClusterState, report: Report) -> Tunnels:
        """Those by which servers reach a client that listens. Whoever opens them closes them."""
        return Tunnels(self.cluster, state.listen_port, report)

    def volume(self, name: str) -> str:
        """The name of a volume as the servers take it: a relative one lies below each machine's data-root."""
        here = all(machine.launcher == "local" and machine.data_root is None for machine in self.cluster.machines)
        return absolute_name(name) if here else name

    def state(self) -> ClusterState | None:
        """None where it is not up. Raises BadInput where it was brought up by another file than it is now."""
        state = self.folder.load()
        if state is not None and state.file != self._text:
            raise BadInput(
                f"{self.path}: has changed since the cluster {self.cluster.name} was brought up; end that first: "
                f"volsplat deploy down {self.path}"
            )
        if state is not None:
            self._check_is_here(state, self.cluster)
        return state

    def _check_is_here(self, state: ClusterState, cluster: Cluster) -> None:
        """Raises BadInput where servers of another machine with the same home would be taken for this one's."""
        runs_local = any(cluster.machines[one.machine].launcher == "local" for one in state.servers)
        if runs_local and state.host not in ("", socket.gethostname()):
            raise BadInput(
                f"servers of the cluster {self.cluster.name} run on {state.host}; use them there, and end them there. "
                f"If that machine is gone or has another name now, remove {self.folder.path / 'state.json'}: servers "
                f"end by themselves after {cluster.keep:g} s without a client"
            )

    def up(self, report: Report) -> ClusterState:
        """Start what is missing. Raises MachinesFailed, which names each that did, and BadInput."""
        with self.folder.locked():
            state = self.state() or ClusterState(
                file=self._text,
                listen_port=_free_port(self.cluster),
                mark=token_hex(8),
                host=socket.gethostname(),
            )
            said = self._states(self.cluster, state.servers)
            self.unheard = self._unheard(state, said)
            living = [one for one in state.servers if said[one.started.name].state is not ServerState.ENDED]
            due = {one.name for one in wanted_servers(self.cluster)} - {one.started.name for one in living}
            state, failed = self._brought_up(state, living, due, report)
        if failed:
            raise MachinesFailed(failed, state)
        return state

    def heard_of(self, state: ClusterState) -> ClusterState:
        """The state as up() has left it, without servers that nobody can tell whether they run."""
        unknown = self.not_asked(state).keys() | self.unheard.keys()
        servers = tuple(one for one in state.servers if one.started.name not in unknown)
        return msgspec.structs.replace(state, servers=servers)

    def _unheard(self, state: ClusterState, said: Mapping[str, Said]) -> dict[str, str]:
        titles = {one.started.name: self.cluster.machines[one.machine].title for one in state.servers}
        asked = titles.keys() - self.not_asked(state).keys()
        return {
            name: f"{titles[name]}: unknown: {said[name].reason.removeprefix(f'{titles[name]}: ')}"
            for name in titles
            if name in asked and said[name].state is ServerState.UNKNOWN
        }

    def up_anew(self, known: ClusterState, names: Collection[str], report: Report) -> ClusterState:
        """Start others in the place of the servers of these names, once these have ended, if it is up as it is `known`.

        Raises as up() does. One whose place nobody has taken stays known as one that has ended.
        """
        with self.folder.locked():
            state = self.state()
            if state is None or state.mark != known.mark or state.unanswered_since:
                raise BadInput(
                    f"no server of the cluster {self.cluster.name} is started anew: another command has brought it down"
                )
            asked = [one for one in state.servers if one.started.name in names]
            said = self._states(self.cluster, asked)
            self._stop(self.cluster, [one for one in asked if said[one.started.name].state is not ServerState.ENDED])
            state, failed = self._brought_up(state, state.servers, set(names), report)
        if failed:
            raise MachinesFailed(failed, state)
        return state

    def _brought_up(
        self, state: ClusterState, servers: Collection[KnownServer], due: Collection[str], report: Report
    ) -> tuple[ClusterState, list[str]]:
        """Beside these servers start those of the names that are due. The second is what failed."""
        known = {one.started.name: one for one in servers}
        state = msgspec.structs.replace(state, unanswered_since={})
        self.folder.save(state)
        failed = self._start(state, due, report, known)
        state = msgspec.structs.replace(state, servers=tuple(known.values()))
        self._remember(state, due)
        return state, failed

    def _remember(self, state: ClusterState, started: Collection[str]) -> None:
        """What was started is ended again if it cannot be: nobody would know of it."""
        try:
            self.folder.save(state)
        except BadInput:
            self._stop(self.cluster, [one for one in state.servers if one.started.name in started])
            raise

    def _start(
        self, state: ClusterState, due: Collection[str], report: Report, known: dict[str, KnownServer]
    ) -> list[str]:
        """Add what was started to `known`, and remember it as soon as it is; what failed is in the answer."""
        secrets = Secrets(self.token, self.token_file)
        remembering = threading.Lock()
        wanted = wanted_servers(self.cluster)

        def start(number: int) -> None:
            every = orders_of(self.cluster, [one for one in wanted if one.machine == number], state.listen_port)
            orders = [one for one in every if one.order.name in due]
            launcher = self._launcher(self.cluster, number)
            started = launcher.start([one.order for one in orders], secrets, report)
            found = [
                KnownServer(
                    started=server,
                    program=one.order.program,
                    machine=number,
                    wait_at=str(one.wait_at) if one.wait_at else "",
                )
                for one, server in zip(orders, started, strict=True)
            ]
            with remembering:  # on this thread, which Ctrl-C does not interrupt
                more = known | {one.started.name: one for one in found}
                self._remember(
                    msgspec.structs.replace(state, servers=tuple(more.values())), {one.order.name for one in orders}
                )
                known.update(more)

        results = _on_all(sorted({one.machine for one in wanted if one.name in due}), start)
        return [result.reason for result in results.values() if isinstance(result, Failed)]

    def wanted(self, state: ClusterState) -> int:
        """How many servers there are once all are started."""
        cluster = cluster_from_toml(state.file, str(self.path))
        return cluster.map_shade_servers + cluster.splat_servers

    def never_started(self, state: ClusterState) -> list[tuple[str, str]]:
        """Machines that failed as it was brought up, with how many of their servers are missing, and the cure.

        None are named as long as another command may start them.
        """
        if self.folder.is_locked:
            return []
        found = []
        for number, machine in enumerate(cluster_from_toml(state.file, str(self.path)).machines):
            wanted = machine.map_shade_servers + machine.splat_servers
            missing = wanted - sum(one.machine == number for one in state.servers)
            if missing:
                line = f"{missing} of {wanted} servers could not be started; try again: volsplat deploy up {self.path}"
                found.append((machine.title, line))
        return found

    def not_asked(self, state: ClusterState) -> dict[str, str]:
        """Servers that people start and end, by name, each with the title of its machine."""
        machines = cluster_from_toml(state.file, str(self.path)).machines
        places = {one.started.name: machines[one.machine] for one in state.servers}
        return {name: machine.title for name, machine in places.items() if machine.launcher in BY_HAND}

    def statuses(self) -> list[tuple[KnownServer, Said]]:
        """Of every server that was started, in the file's order."""
        state = self.folder.load()
        if state is None:
            return []
        said = self._states(cluster_from_toml(state.file, str(self.path)), state.servers)
        return [(one, said[one.started.name]) for one in state.servers]

    def _states(self, cluster: Cluster, servers: Collection[KnownServer]) -> dict[str, Said]:
        by_machine = defaultdict[int, list[StartedServer]](list)
        for one in servers:
            by_machine[one.machine].append(one.started)

        def ask(number: int) -> Mapping[str, Said]:
            return self._launcher(cluster, number).states(by_machine[number])

        told: dict[str, Said] = {}
        for number, result in _on_all(sorted(by_machine), ask, may_be_left=True).items():
            if isinstance(result, Failed):
                told |= {server.name: Said(ServerState.UNKNOWN, result.reason) for server in by_machine[number]}
            else:
                told |= result
        return told

    def down(self, report: Report) -> None:
        """End every server. Raises BadInput, which names those machines that do not answer.

        They stay remembered for as long as their servers stay without a client.
        """
        with self.folder.locked():
            state = self.folder.load()
            if state is None:
                self.folder.forget()
                report(f"the cluster {self.cluster.name} is not up")
                return
            cluster = cluster_from_toml(state.file, str(self.path))
            self._check_is_here(state, cluster)
            failed = self._stop(cluster, state.servers, report)
            now = Moment.now()
            known = {number: state.unanswered_since.get(number, now) for number in failed}
            since = {number: moment if moment.until(now) else now for number, moment in known.items()}
            left = {number: cluster.keep - since[number].until(now) for number in failed}
            due = {number: seconds for number, seconds in left.items() if seconds > 0}
            queued = {number: _unless_queued(cluster, state, number) for number in failed}
            for number in left.keys() - due.keys():
                line = f"{failed[number]}; its servers have ended by themselves, after {cluster.keep:g} s"
                report(line + queued[number])
            if not due:
                self.folder.forget()
                return
            servers = tuple(one for one in state.servers if one.machine in due)
            self.folder.save(msgspec.structs.replace(state, servers=servers, unanswered_since=since))
        raise BadInput(
            f"not everything is down: {'; '.join(failed[number] for number in due)}; run it again when they answer, or "
            f"in {math.ceil(max(due.values()))} s: their servers have ended by themselves then"
            + "".join(queued[number] for number in due)
        )

    def _stop(
        self, cluster: Cluster, servers: Collection[KnownServer], report: Report = lambda line: None
    ) -> dict[int, str]:
        """End them. What failed is in the answer, by machine."""

        def stop(number: int) -> None:
            of_machine = [one.started for one in servers if one.machine == number]
            machine = cluster.machines[number]
            if machine.launcher not in BY_HAND:
                report(f"{machine.title}: ending {len(of_machine)} servers")
            self._launcher(cluster, number).stop(of_machine, lambda line: report(f"{machine.title}: {line}"))

        results = _on_all(sorted({one.machine for one in servers}), stop)
        return {number: result.reason for number, result in results.items() if isinstance(result, Failed)}

    def logs(self, one: KnownServer, lines: int) -> str:
        state = self.folder.load()
        cluster = cluster_from_toml(state.file, str(self.path)) if state is not None else self.cluster
        return self._launcher(cluster, one.machine).logs(one.started, lines)

    def _launcher(self, cluster: Cluster, number: int) -> Launcher:
        return launcher_of(cluster.machines[number], self.folder.path)


def _unless_queued(cluster: Cluster, state: ClusterState, number: int) -> str:
    """Which servers of a machine may begin only once others have ended by themselves; empty where none may."""
    machine = cluster.machines[number]
    command = cancelling(machine, [one.started for one in state.servers if one.machine == number])
    return f", but for those that {machine.title} has not begun yet; end these by: {command}" if command else ""


def _on_all(machines: list[int], act: Callable[[int], Result], may_be_left: bool = False) -> dict[int, Result | Failed]:
    """Act on every machine at once. An interruption, and the end of this process, wait for those acts that have begun
    unless these `may_be_left`; no other one begins.

    By threads of its own: executors take nothing more when a script ends, and with it the session that it never closed.
    """
    acting = {number: Future[Result]() for number in machines}
    free = threading.Semaphore(MOST_AT_ONCE)

    def act_on(number: int, done: Future[Result]) -> None:
        with free:
            if not done.set_running_or_notify_cancel():
                return
            try:
                done.set_result(act(number))
            except Exception as error:  # raised where it is waited for
                done.set_exception(error)

    try:
        for number, done in acting.items():
            threading.Thread(target=act_on, args=(number, done), name=f"machine {number}", daemon=may_be_left).start()
        wait(acting.values())
    finally:
        begun = [done for done in acting.values() if not done.cancel()]
        if not may_be_left:
            wait(begun)
    results: dict[int, Result | Failed] = {}
    for number, done in acting.items():
        try:
            results[number] = done.result()
        except BadInput as error:
            results[number] = Failed(str(error))
    return results


def _free_port(cluster: Cluster) -> int:
    """Where clients listen for servers that dial in. What tunnels carry follows it, and is free as well."""
    if cluster.client is not None:
        return int(cluster.client.rpartition(":")[2])
    while True:
        port = SystemRandom().randrange(*BELOW_CONNECTIONS)
        with ExitStack() as free:
            with suppress(OSError):  # another one is tried
                for further in range(port, last_port(cluster, port) + 1):
                    free.enter_context(socket.create_server(("", further)))
                return port
