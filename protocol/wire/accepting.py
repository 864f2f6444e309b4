"""The accepting side of the handshake, over a connection: who proves that it knows the token gets an id."""

import itertools
import threading
from collections.abc import Callable

from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.versions import SPOKEN, VersionRange
from volsplat.protocol.text.errors import BadInput, RemoteProtocolError, TurnedAway, VolsplatError
from volsplat.protocol.text.printable import printable
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import AccepterHandshake, State
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.tokens import Token


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


class Accepter:
    """Shakes hands with peers, by whichever way they came. Any threads may call it."""

    def __init__(
        self,
        role: Role,
        token: Token,
        *,
        assign_id: Callable[[Hello], int] | None = None,
        token_of: Callable[[Hello], Token] | None = None,
        allocate: Allocate = new_buffer,
        versions: VersionRange = SPOKEN,
    ) -> None:
        """`assign_id` gives a proven peer its id, or raises VolsplatError to reject it.

        `token_of` gives the token that a peer must know in the place of `token`, or raises TooEarly to have it dial
        again; several threads may call it at a time.
        """
        self._role, self._token, self._versions = role, token, versions
        self._assign_id = assign_id or IdCounter()
        self._assigning = threading.Lock()  # one call at a time
        self._token_of = token_of
        self._allocate = allocate

    def greet(self, connection: Connection, address: Address) -> None:
        """Run the handshake and open the connection; `address` is the peer's.

        Raises BadInput where the peer is rejected, or what the connection raises.
        """
        handshake = AccepterHandshake(self._token, self._role, self._versions, token_of=self._token_of)
        hello = _proven(connection, handshake)
        try:
            with self._assigning:
                server = self._assign_id(hello)
        except VolsplatError as error:
            connection.send(handshake.reject(str(error)))
            raise BadInput(f"{connection} is rejected: {error}") from error
        connection.send(handshake.welcome(server))
        connection.open(_peer(hello, address, server, handshake.version), self._role, 0, self._allocate)


def _proven(connection: Connection, handshake: AccepterHandshake) -> Hello:
    """What the peer says of itself, once it has shown that it knows the token."""
    handshake.binding = connection.binding
    while handshake.state is not State.PROVEN:
        received = connection.receive()
        if received is None:
            raise ConnectionClosed(f"{connection} was dropped during its handshake")
        try:
            answer = handshake.receive(received.message)
        except RemoteProtocolError as error:
            raise RemoteProtocolError(f"{connection} broke the protocol: {error}") from error
        except TurnedAway as error:
            raise TurnedAway(f"{connection} {error}") from error
        if answer is not None:
            connection.send(answer)
        if handshake.state is State.REJECTED:
            raise BadInput(f"{connection} is rejected: {handshake.rejection}")
    assert handshake.hello is not None
    return handshake.hello


def _peer(hello: Hello, address: Address, id: int, version: int) -> Peer:
    return Peer(
        role=hello.role,
        host=address.host,
        port=address.port,
        id=id,
        version=version,
        name=printable(hello.name),
        data_host=(hello.data_host or address.host) if hello.data_port else "",
        data_port=hello.data_port,
        data_anywhere=bool(hello.data_port) and not hello.data_host,
    )
