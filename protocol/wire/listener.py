"""The accepting side: a port that lets in peers that know the session token, and nobody else.

Each handshake runs in its own thread under a time limit, so a peer that says nothing holds up no other. Of those
that have not proved themselves only so many may wait; the oldest makes room, since honest ones take milliseconds.
"""

import errno
import itertools
import logging
import queue
import socket
import threading
from collections.abc import Callable
from contextlib import suppress

from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.versions import SPOKEN, VersionRange
from volsplat.protocol.text.errors import BadInput, RemoteProtocolError, TooEarly, VolsplatError
from volsplat.protocol.text.printable import printable
from volsplat.protocol.text.rare_lines import RareLines
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.connection import Connection, ConnectionClosed, Peer
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import AccepterHandshake, State
from volsplat.protocol.wire.tokens import Token
from volsplat.protocol.wire.unix_socket import is_ours, opened_door

HANDSHAKE_SECONDS = 5.0
MOST_PENDING = 64  # handshakes at a time
BACKLOG = 128
SHORTAGE_PAUSE_SECONDS = 0.1  # when the system has no socket left to give
HERE = Address(LOOPBACK, 0)  # of callers that come by the Unix socket

log = logging.getLogger(__name__)


class IdCounter:
    """Gives ids 1, 2, 3, … to servers; a data link keeps that of its server."""

    def __init__(self) -> None:
        self._numbers = itertools.count(1)

    def __call__(self, hello: Hello) -> int:
        if hello.role != Role.DATA_LINK:
            return next(self._numbers)
        if hello.server == 0:
            raise BadInput("a data link must name its server's id, but Hello.server is 0")
        return hello.server


class Listener:
    """Listens from when it is made; accept() gives the connections that have passed the handshake."""

    def __init__(
        self,
        role: Role,
        token: Token,
        *,
        host: str = LOOPBACK,
        port: int = 0,
        assign_id: Callable[[Hello], int] | None = None,
        token_of: Callable[[Hello], Token] | None = None,
        allocate: Allocate = new_buffer,
        versions: VersionRange = SPOKEN,
        handshake_seconds: float = HANDSHAKE_SECONDS,
        most_pending: int = MOST_PENDING,
    ) -> None:
        """`port` 0 takes any free one. `assign_id` gives a proven peer its id, or raises VolsplatError to reject it.
        `token_of` gives the token that a peer must know in the place of `token`, or raises TooEarly to have it dial
        again; several threads may call it at a time.
        Raises BadInput where the address cannot be had.
        """
        self._role, self._token, self._versions = role, token, versions
        self._assign_id = assign_id or IdCounter()
        self._token_of = token_of
        self._allocate = allocate
        self._handshake_seconds = handshake_seconds
        self._most_pending = most_pending
        self.lines = RareLines(log)  # about those who come in here
        port_socket = _bound(host, port)
        self.address = Address(*port_socket.getsockname()[:2])
        door = opened_door(self.address, BACKLOG)
        self._lock = threading.Lock()  # guards _pending, what is put into _accepted, and calls of _assign_id
        self._pending: dict[Connection, threading.Thread] = {}  # oldest first
        self._closing = threading.Event()
        self._accepted: queue.SimpleQueue[Connection | None] = queue.SimpleQueue()
        self._ways = [  # with the threads that accept there; the port is the last to be closed
            (way, threading.Thread(target=self._take_calls, args=(way,), name=f"accept at {self.address}", daemon=True))
            for way in (door, port_socket)
            if way is not None
        ]
        for _, thread in self._ways:
            thread.start()

    def accept(self, timeout: float | None = None) -> Connection | None:
        """The next connection that is open; None once the listener is closed, or after `timeout` seconds."""
        try:
            connection = self._accepted.get(timeout=timeout)
        except queue.Empty:
            return None
        if connection is None:
            self._accepted.put(None)  # for the next caller
        return connection

    def close(self) -> None:
        """Stop listening, and close what is not accepted yet. Accepted connections stay. May be called again."""
        with self._lock:
            if self._closing.is_set():
                return
            self._closing.set()
        for way, thread in self._ways:
            with suppress(OSError):  # macOS has nothing to shut down here
                way.shutdown(socket.SHUT_RDWR)  # wakes accept(); close() alone does not
            thread.join()
            way.close()
        with self._lock:  # only now, when no more come
            pending = list(self._pending.items())
        for connection, thread in pending:
            connection.close()
            thread.join()
        self._accepted.put(None)
        while (unclaimed := self._accepted.get()) is not None:
            unclaimed.close()
        self._accepted.put(None)
        self.lines.close()

    def __enter__(self) -> "Listener":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take_calls(self, way: socket.socket) -> None:
        while not self._closing.is_set():
            try:
                caller, address = way.accept()
            except OSError as error:
                if not self._closing.is_set():
                    self._drop_oldest(f"{self.address} cannot accept: {error.strerror}")
                    self._closing.wait(SHORTAGE_PAUSE_SECONDS)
                continue
            if caller.family != socket.AF_UNIX:
                self._begin(caller, Address(*address[:2]))
            elif is_ours(caller):
                self._begin(caller, HERE)
            else:
                self.lines.warn(f"a caller at {self.address} is another user of this machine; the connection is closed")
                caller.close()

    def _begin(self, caller: socket.socket, address: Address) -> None:
        connection = Connection(caller, f"the peer at {address}" if address.port else "a peer on this machine")
        connection.limit(self._handshake_seconds)
        thread = threading.Thread(
            target=self._handle, args=(connection, address), name=f"handshake with {address}", daemon=True
        )
        with self._lock:
            crowded = len(self._pending) >= self._most_pending
            self._pending[connection] = thread
        if crowded:
            self._drop_oldest(f"{self._most_pending} handshakes are waiting at {self.address}")
        try:
            thread.start()
        except RuntimeError as error:  # the system has no thread left to give
            with self._lock:
                del self._pending[connection]
            self.lines.warn(f"{connection} is dropped: {error}")
            connection.close()

    def _drop_oldest(self, cause: str) -> None:
        with self._lock:
            connection = next(iter(self._pending), None)
            if connection is not None:
                del self._pending[connection]
        if connection is None:
            self.lines.warn(cause)
        else:
            self.lines.warn(f"{cause}; {connection} is dropped, the oldest in its handshake")
            connection.close()

    def _handle(self, connection: Connection, address: Address) -> None:
        failure = ""
        try:
            self._shake_hands(connection, address)
        except ConnectionClosed:
            log.debug("%s is gone: this side closed it", connection)
        except TooEarly as error:
            log.debug("%s is to dial again: %s", connection, error)
        except VolsplatError as error:
            failure = printable(str(error))
        with self._lock:
            mine = self._pending.pop(connection, None) is not None
            if mine and connection.opened and not self._closing.is_set():
                self._accepted.put(connection)
                return
        connection.close()
        if mine and failure:
            self.lines.warn(f"{failure}; the connection is closed")

    def _shake_hands(self, connection: Connection, address: Address) -> None:
        """Runs the handshake. Raises BadInput where the peer is rejected, or what the connection raises."""
        handshake = AccepterHandshake(self._token, self._role, self._versions, token_of=self._token_of)
        while handshake.state is not State.PROVEN:
            received = connection.receive()
            if received is None:
                raise ConnectionClosed(f"{connection} was dropped during its handshake")
            try:
                answer = handshake.receive(received.message)
            except RemoteProtocolError as error:
                raise RemoteProtocolError(f"{connection} broke the protocol: {error}") from error
            if answer is not None:
                connection.send(answer)
            if handshake.state is State.REJECTED:
                raise BadInput(f"{connection} is rejected: {handshake.rejection}")
        hello = handshake.hello
        assert hello is not None
        try:
            with self._lock:
                server = self._assign_id(hello)
        except VolsplatError as error:
            connection.send(handshake.reject(str(error)))
            raise BadInput(f"{connection} is rejected: {error}") from error
        peer = Peer(
            role=hello.role,
            host=address.host,
            port=address.port,
            id=server,
            version=handshake.version,
            name=printable(hello.name),
            data_host=(hello.data_host or address.host) if hello.data_port else "",
            data_port=hello.data_port,
        )
        connection.send(handshake.welcome(server))
        connection.open(peer, self._role, 0, self._allocate)


def _bound(host: str, port: int) -> socket.socket:
    place = Address(host, port)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except socket.gaierror as error:
        raise BadInput(
            f"cannot listen at {place}: the name {host} is unknown; give an address of this machine"
        ) from error
    listening = socket.socket(family, kind, protocol)
    try:
        # Without it, a port stays unusable for minutes after a listener's connections have closed.
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(BACKLOG)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise BadInput(f"port {port} at {host} is already in use; choose another, or 0 for any free one") from error
        raise BadInput(f"cannot listen at {place}: {error.strerror}; choose another host or port") from error
    return listening
