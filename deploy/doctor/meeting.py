"""The doctor as a client: a cluster's servers join it, and answer what it asks."""

import logging
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import ClusterState, KnownServer
from volsplat.deploy.launchers.launcher import Said, ServerState
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import EndSession, Refused
from volsplat.protocol.text.errors import BadInput, PeerLost, RemoteProtocolError, VolsplatError
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.addresses import parse_address
from volsplat.protocol.wire.calling import call
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.heartbeat import UNTAKEN, Heartbeat
from volsplat.protocol.wire.listener import Listener

log = logging.getLogger(__name__)

LOOK_SECONDS = 2.0  # between two looks at what a missing server's launcher knows of it
LATE_SECONDS = 30.0  # for all servers to come: what they load takes seconds where much else runs

Answer = TypeVar("Answer", bound=Message)


class Meeting:
    """Takes every server that comes until it is closed. Any thread may call it."""

    def __init__(self, running: RunningCluster, state: ClusterState) -> None:
        """Raises BadInput where another client of this machine takes them."""
        self._running, self._state = running, state
        self._encryption = running.cluster.encryption
        self._came = threading.Condition()  # guards what follows
        self._there: dict[str, Connection] = {}
        self._why: dict[str, str] = {}  # each that is dialled is not there
        self._unusable: set[str] = set()  # of those: another try would end alike
        self._closed = threading.Event()
        self._deadline = time.monotonic() + LATE_SECONDS
        self._listener = self._listening()
        self.tunnels = running.tunnels(state, log.info)
        self._heartbeat = Heartbeat(running.cluster.silence)
        threading.Thread(target=self._accept, name="accept servers", daemon=True).start()
        for one in state.servers:
            if one.wait_at:
                threading.Thread(target=self._call, args=(one,), name=f"call {one.started.name}", daemon=True).start()

    def _listening(self) -> Listener:
        (host, port), token = self._running.listens_at(self._state), self._running.token
        try:
            return Listener(Role.CLIENT, token, host=host, port=port, encryption=self._encryption)
        except BadInput as error:
            raise self._running.cannot_listen(error) from error

    def server(self, one: KnownServer) -> Connection:
        """It, once it has come. Raises PeerLost with why it has not, as its own log or who dials it knows."""
        name = one.started.name
        while True:
            with self._came:
                self._came.wait_for(lambda: name in self._there or name in self._unusable, LOOK_SECONDS)
                if name in self._there:
                    return self._there[name]
                why = self._why.get(name, "")
                if name in self._unusable:
                    raise PeerLost(why)
            said = self._said(one)
            if said.state is ServerState.ENDED:
                raise PeerLost(f"it has ended: {said.reason}; see: volsplat deploy logs {self._running.path}")
            if time.monotonic() > self._deadline:
                raise PeerLost(why or self._last_line(one) or said.reason or "it has not come, and says nothing")

    def _said(self, one: KnownServer) -> Said:
        return {known.started.name: said for known, said in self._running.statuses()}[one.started.name]

    def _last_line(self, one: KnownServer) -> str:
        try:
            return one_line(self._running.logs(one, 1))
        except BadInput as error:
            return str(error)

    def ask(self, server: Connection, request: Message, kind: type[Answer], *payload: bytes) -> Answer:
        """Its answer. Raises BadInput where it refuses, PeerLost or RemoteProtocolError where it is lost."""
        server.send(request, *payload)
        received = server.receive()
        match received.message if received is not None else None:
            case kind() as answer:
                return answer
            case Refused(cause=cause):
                raise BadInput(cause)
            case other:
                raise RemoteProtocolError(f"{server} answers {type(request).__name__} by {type(other).__name__}")

    def close(self) -> None:
        """Let the servers go: they look for the next client."""
        self._closed.set()
        self._listener.close()
        with self._came:
            there = list(self._there.values())
        for server in there:
            _let_go(server)
        self._heartbeat.close()
        self.tunnels.close()

    def _accept(self) -> None:
        while (connection := self._listener.accept()) is not None:
            known = next((one for one in self._state.servers if one.is_process(connection.peer.name)), None)
            if known is None:
                log.warning("%s joins, but is none of this cluster's servers", connection)
                connection.close()
            else:
                self._take(known, connection)

    def _call(self, one: KnownServer) -> None:
        def note(line: str) -> None:
            with self._came:
                self._why[one.started.name] = line

        while not self._closed.is_set():
            try:
                self._take(one, self._dialled(one, note))
                return
            except PeerLost as error:
                note(str(error))
                self._closed.wait(LOOK_SECONDS)
            except VolsplatError as error:
                note(str(error))
                self._give_up(one)
                return

    def _give_up(self, one: KnownServer) -> None:
        with self._came:
            self._unusable.add(one.started.name)
            self._came.notify_all()

    def _dialled(self, one: KnownServer, note: Callable[[str], None]) -> Connection:
        return call(
            parse_address(one.wait_at),
            one.started.name,
            self._listener.accepter,
            encryption=self._encryption,
            patience=LATE_SECONDS,
            report=note,
            given_up=self._closed.is_set,
        )

    def _take(self, one: KnownServer, connection: Connection) -> None:
        connection.lose_after(UNTAKEN * self._heartbeat.silence)
        self._heartbeat.keep(connection, lambda: self._heartbeat.silence)
        with self._came:
            self._there[one.started.name] = connection
            self._came.notify_all()
        if self._closed.is_set():
            _let_go(connection)


def _let_go(server: Connection) -> None:
    try:
        server.send(EndSession())
    except VolsplatError as error:
        log.info("%s is gone already: %s", server, error)
    server.close()
