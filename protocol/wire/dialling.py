"""Dialling a listener: connect, with patience for one that is not up yet, and shake hands."""

import errno
import secrets
import socket
import time
from collections.abc import Callable

import msgspec

from volsplat.protocol.messages.greetings import NONCE_BYTES, Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, NobodyListens, PeerLost, RemoteProtocolError, TurnedAway
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import DiallerHandshake, State
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.port import HANDSHAKE_SECONDS
from volsplat.protocol.wire.tokens import Token
from volsplat.protocol.wire.unix_socket import entered_door

FIRST_PAUSE_SECONDS = 0.05  # between two tries; doubled after each
LONGEST_PAUSE_SECONDS = 0.5
CONNECT_SECONDS = 5.0  # for one try
ANSWERED_SECONDS = 2 * HANDSHAKE_SECONDS  # for a handshake: who listens, and knows more, gives up first
PATIENCE_SECONDS = 30.0

# Worth another try: the other end may be starting, or its network.
PASSING = {
    errno.ECONNREFUSED,
    errno.ECONNRESET,
    errno.EHOSTDOWN,
    errno.EHOSTUNREACH,
    errno.ENETDOWN,
    errno.ENETUNREACH,
    errno.ETIMEDOUT,
}
FULL = {errno.EMFILE, errno.ENFILE}  # of open files, sockets among them


def _unheard(error: PeerLost) -> None:
    """Tells nobody."""


def connect(
    address: Address,
    hello: Hello,
    token: Token,
    expected: Role,
    *,
    server: int = 0,
    encryption: Encryption = Encryption.BETWEEN_MACHINES,
    patience: float = PATIENCE_SECONDS,
    handshake_seconds: float = ANSWERED_SECONDS,
    allocate: Allocate = new_buffer,
    report: Callable[[PeerLost], None] = _unheard,
    given_up: Callable[[], bool] = lambda: False,
) -> Connection:
    """An open connection to the `expected` role at `address`.

    `hello` (see handshake.new_hello) says who dials; `server` is the id of a splat server that is dialled. For
    `patience` seconds it is tried again while nobody listens there, or who does has no thread for this side, unless it
    is `given_up` meanwhile; `report` gets each reason once.
    Raises PeerLost where nobody answers in time, BadInput where a person must put it right (unknown name, another
    token or version, another kind of server), RemoteProtocolError where something else than volsplat listens.
    """
    place = f"{expected} at {address}"

    def attempt() -> Connection:
        fresh = msgspec.structs.replace(hello, nonce=secrets.token_bytes(NONCE_BYTES))  # one nonce for each try
        handshake = DiallerHandshake(token, fresh, expected)
        return _try_once(address, place, handshake, server, encryption, handshake_seconds, allocate)

    return patiently(attempt, patience, report, given_up)


def patiently(
    attempt: Callable[[], Connection],
    patience: float,
    report: Callable[[PeerLost], None],
    given_up: Callable[[], bool],
) -> Connection:
    """What comes of the first attempt that meets no PeerLost; it is made again and again for `patience` seconds.

    `report` gets each reason why it goes on, once.
    """
    give_up_at = time.monotonic() + patience
    pause, told = FIRST_PAUSE_SECONDS, ""
    while True:
        try:
            return attempt()
        except PeerLost as error:
            if given_up():
                raise PeerLost(f"{error} (given up)") from error
            if time.monotonic() + pause > give_up_at:
                raise PeerLost(f"{error} (tried for {patience:g} s)") from error
            if str(error) != told:
                told = str(error)
                report(error)
        time.sleep(pause)
        pause = min(2 * pause, LONGEST_PAUSE_SECONDS)


def _try_once(
    address: Address,
    place: str,
    handshake: DiallerHandshake,
    server: int,
    encryption: Encryption,
    seconds: float,
    allocate: Allocate,
) -> Connection:
    connection = Connection(dialled_socket(address, place), place)
    try:
        connection.limit(seconds)
        connection.encrypt(encryption, accepts=False)
        shake_hands(connection, handshake)
        peer = Peer(handshake.expected, address.host, address.port, id=server, version=handshake.version)
        connection.open(peer, handshake.hello.role, handshake.id, allocate)
    except (BadInput, TurnedAway) as error:
        connection.close()
        raise type(error)(f"cannot join the {place}: {error}") from error
    except BaseException:
        connection.close()
        raise
    return connection


def dialled_socket(address: Address, place: str) -> socket.socket:
    """Connected to whoever listens there. Raises PeerLost where another try may help, else BadInput."""
    try:
        by_door = entered_door(address, CONNECT_SECONDS)
        return by_door or socket.create_connection(address, timeout=CONNECT_SECONDS)
    except (socket.gaierror, UnicodeError) as error:  # the latter for labels that no name may have
        if isinstance(error, socket.gaierror) and error.errno == socket.EAI_AGAIN:
            told = f"the name {address.host} cannot be looked up now; check the network, or give an IP address"
            raise PeerLost(f"cannot find the {place}: {told}") from error
        raise BadInput(f"cannot find the {place}: the name {address.host} is unknown; check it") from error
    except TimeoutError as error:
        raise PeerLost(f"cannot reach the {place}: no answer; check the address and the firewalls between") from error
    except OSError as error:
        if error.errno == errno.ECONNREFUSED:
            told = f"cannot reach the {place}: nobody listens there; start it or check the port"
            raise NobodyListens(told) from error
        if error.errno in FULL:
            raise BadInput(
                f"cannot reach the {place}: this machine lets a program open no more files; raise `ulimit -n`"
            ) from error
        if error.errno in PASSING:
            raise PeerLost(f"cannot reach the {place}: {error.strerror}; check the network between") from error
        raise BadInput(f"cannot reach the {place}: {error.strerror or error}; check the address") from error


def shake_hands(connection: Connection, handshake: DiallerHandshake) -> None:
    """Run the dialler's side to its end. Raises BadInput where either side rejects, TurnedAway where
    that may pass, or what the connection raises.
    """
    handshake.binding = connection.binding
    connection.send(handshake.start())
    while handshake.state is not State.OPEN:
        received = connection.receive()
        if received is None:
            raise PeerLost(f"the connection to {connection} was closed during the handshake")
        try:
            answer = handshake.receive(received.message)
        except RemoteProtocolError as error:
            raise RemoteProtocolError(f"{connection} broke the protocol: {error}") from error
        if answer is not None:
            connection.send(answer)
        if handshake.state is State.REJECTED:
            raise BadInput(f"{connection} is turned away: this side {handshake.rejection}")
