"""A port that takes callers, each greeted in a thread of its own under a time limit; those who pass are accepted.

A peer that says nothing holds up no other. Of those that are being greeted only so many may wait; the oldest makes
room, since honest ones take milliseconds.
"""

import errno
import logging
import queue
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address
from typing import Self

from volsplat.protocol.messages.greetings import Rejected
from volsplat.protocol.text.errors import BadInput, TooEarly, VolsplatError
from volsplat.protocol.text.printable import printable
from volsplat.protocol.text.rare_lines import RareLines
from volsplat.protocol.text.want_of_threads import CURE
from volsplat.protocol.wire.addresses import EVERYWHERE, LOOPBACK, Address, plain_host
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.tls_channel import ONE_SIDED, PlainCaller
from volsplat.protocol.wire.unix_socket import is_ours, opened_door

HANDSHAKE_SECONDS = 5.0
MOST_PENDING = 64  # handshakes at a time
BACKLOG = 1024  # callers that the system holds until they are taken; one too many tries again after a second, or later
REFUSAL_SECONDS = 1.0  # for one that is told by the thread that accepts: others wait behind it
SHORTAGE_PAUSE_SECONDS = 0.1  # when the system has no socket left to give
HERE = Address(LOOPBACK, 0)  # of callers that come by the Unix socket

Greet = Callable[[Connection, Address], None]  # shakes hands, or raises VolsplatError

log = logging.getLogger(__name__)


class Port:
    """Listens from when it is made; accept() gives the connections that have passed the handshake."""

    def __init__(
        self,
        greet: Greet,
        host: str,
        port: int,
        handshake_seconds: float = HANDSHAKE_SECONDS,
        most_pending: int = MOST_PENDING,
        encryption: Encryption = Encryption.BETWEEN_MACHINES,
    ) -> None:
        """`port` 0 takes any free one. Several threads may call `greet` at a time.

        Raises BadInput where the address cannot be had.
        """
        self._greet = greet
        self._handshake_seconds = handshake_seconds
        self._encryption = encryption
        self._most_pending = most_pending
        self.lines = RareLines(log)  # about those who come in here
        port_socket = _bound(host, port)
        self.address = Address(*port_socket.getsockname()[:2])
        door = opened_door(self.address, BACKLOG)
        self._lock = threading.Lock()  # guards _pending, and what is put into _accepted
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take_calls(self, way: socket.socket) -> None:
        while not self._closing.is_set():
            try:
                self._take_call(way)
            except (OSError, MemoryError, RuntimeError) as error:  # the next one may find what this one lacked
                if not self._closing.is_set():
                    self._drop_oldest(f"{self.address} cannot accept: {_reason(error)}")
                    self._closing.wait(SHORTAGE_PAUSE_SECONDS)

    def _take_call(self, way: socket.socket) -> None:
        caller, address = way.accept()
        if caller.family != socket.AF_UNIX:
            self._begin(caller, Address(plain_host(address[0]), address[1]))
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
        except (MemoryError, RuntimeError):  # the system has no thread left to give
            with self._lock:
                self._pending.pop(connection, None)
            self._turn_away(connection, f"cannot take another connection: {CURE}")

    def _turn_away(self, connection: Connection, cause: str) -> None:
        """Tell a caller, by the thread that accepts and so in short, why it is not greeted."""
        self.lines.warn(f"{connection} is turned away: this side {cause}")
        connection.limit(min(self._handshake_seconds, REFUSAL_SECONDS))
        try:
            self._secure(connection)
            connection.send(Rejected(cause, passing=True))
        except VolsplatError as error:
            log.debug("%s was not told: %s", connection, error)
        except MemoryError:
            log.debug("%s was not told: no memory is left", connection)
        finally:
            connection.close()

    def _secure(self, connection: Connection) -> None:
        try:
            connection.encrypt(self._encryption, accepts=True)
        except PlainCaller as error:
            connection.send(Rejected(ONE_SIDED))
            raise BadInput(f"{connection} is rejected: {error}") from error
        except BadInput as error:
            raise BadInput(f"{connection} is rejected: {error}") from error

    def _drop_oldest(self, cause: str) -> None:
        with self._lock:
            connection = next((pending for pending in self._pending if not pending.opened), None)
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
            self._secure(connection)
            self._greet(connection, address)
        except ConnectionClosed:
            log.debug("%s is gone: this side closed it", connection)
        except TooEarly as error:
            log.debug("%s is to dial again: %s", connection, error)
        except VolsplatError as error:
            failure = printable(str(error))
        except MemoryError:
            failure = f"{connection} is dropped: this process has no memory left for it"
        with self._lock:
            mine = self._pending.pop(connection, None) is not None
            if mine and connection.opened and not self._closing.is_set():
                self._accepted.put(connection)
                return
        connection.close()
        if mine and failure:
            self.lines.warn(f"{failure}; the connection is closed")


def _reason(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "this process has no memory left"
    return isinstance(error, OSError) and error.strerror or str(error)


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
    if _hides(host, str(address[0])):
        raise BadInput(
            f"cannot listen at {place}: here the name {host} means {address[0]}, which no other machine reaches; give "
            f"an address of this machine, or {Address(EVERYWHERE, port)}"
        )
    listening = socket.socket(family, kind, protocol)
    try:
        # Without it, a port stays unusable for minutes after a listener's connections have closed.
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            listening.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)  # whatever this system's own choice is
        listening.bind(address)
        listening.listen(BACKLOG)
    except OSError as error:
        listening.close()
        if error.errno == errno.EADDRINUSE:
            raise BadInput(f"port {port} at {host} is already in use; choose another, or 0 for any free one") from error
        raise BadInput(f"cannot listen at {place}: {error.strerror}; choose another host or port") from error
    return listening


def _hides(host: str, found: str) -> bool:
    """Whether a name that other machines know this one by stands for this machine alone (Debian's /etc/hosts)."""
    try:
        ip_address(host)
    except ValueError:
        return ip_address(found).is_loopback and not host.startswith("localhost") and not host.endswith(".localhost")
    return False
