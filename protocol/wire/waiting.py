"""The waiting side: a server that is dialled by its clients, one after the other.

Who dials is the client, but in the handshake it is always the server that speaks first (see handshake).
"""

import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec

from volsplat.protocol.messages.greetings import NONCE_BYTES, Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost, TooEarly
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import shake_hands
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import DiallerHandshake, new_hello
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.port import Port
from volsplat.protocol.wire.tokens import Token


class WaitingPort:
    """A port that takes one client at a time; while it is served, others are told so and turned away."""

    def __init__(
        self,
        role: Role,
        address: Address,
        token: Token,
        allocate: Allocate = new_buffer,
        encryption: Encryption = Encryption.BETWEEN_MACHINES,
    ) -> None:
        """`role` is the server's. Raises BadInput where the address cannot be had."""
        self._role = role
        self._token = token
        self._allocate = allocate
        self._lock = threading.Lock()  # guards the three below
        self._hello: Hello | None = None  # of who waits now
        self._engaged = "is not ready yet"
        self._client_host: str | None = None  # of who is served
        self._port = Port(self._greet, address.host, address.port, encryption=encryption)

    @property
    def address(self) -> Address:
        return self._port.address

    def next_client(self, hello: Hello, seconds: float) -> Connection:
        """The next client, which hears `hello`. Raises PeerLost where none comes within so many seconds."""
        with self._lock:
            self._hello = hello
        client = self._port.accept(seconds)
        if client is None:
            with self._lock:
                self._hello, self._engaged, self._client_host = None, "is not ready yet", None
            raise PeerLost(f"no client has come to {self.address} for {seconds:g} s")
        return client

    def close(self) -> None:
        self._port.close()

    def _greet(self, connection: Connection, address: Address) -> None:
        with self._lock:
            hello = self._hello
        fresh = msgspec.structs.replace(hello or new_hello(self._role), nonce=secrets.token_bytes(NONCE_BYTES))
        handshake = DiallerHandshake(self._token, fresh, Role.CLIENT, lambda: self._why_engaged(hello, address.host))
        shake_hands(connection, handshake)
        peer = Peer(Role.CLIENT, address.host, address.port, version=handshake.version)
        with self._engaged_for(peer, hello):
            connection.open(peer, fresh.role, handshake.id, self._allocate)

    @contextmanager
    def _engaged_for(self, client: Peer, hello: Hello | None) -> Iterator[None]:
        """From now on, unless that fails, for this client, which has heard the hello and proved itself.

        Raises TooEarly where another one was faster: it dials again, and is told whom this side serves.
        """
        with self._lock:
            if hello is None or self._hello is not hello:
                raise TooEarly(self._engaged)
            self._hello, self._client_host = None, client.host
            self._engaged = f"serves another client, at {client.host}, since {time.strftime('%H:%M:%S')}"
        try:
            yield
        except BaseException:
            with self._lock:
                self._hello = hello
            raise

    def _why_engaged(self, hello: Hello | None, caller: str) -> str:
        """Empty for a client, at the host `caller`, that has heard the hello of who still waits."""
        with self._lock:
            if hello is not None and self._hello is hello:
                return ""
            own = " (if that is this one: by a connection whose end has not come through yet)"
            return self._engaged + (own if caller == self._client_host else "")
