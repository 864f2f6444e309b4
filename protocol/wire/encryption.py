"""Which links are encrypted: those between machines, unless people have it otherwise at both ends."""

import socket
from enum import Enum

from volsplat.protocol.wire.addresses import is_loopback, plain_host


class Encryption(Enum):
    BETWEEN_MACHINES = "between machines"
    ALWAYS = "always"  # but by Unix sockets: for links that a tunnel takes to another machine
    NEVER = "never"  # for networks that are trusted

    @staticmethod
    def of(tls: bool | None) -> "Encryption":
        """What a person's word means, who may have said nothing."""
        return Encryption.BETWEEN_MACHINES if tls is None else Encryption.ALWAYS if tls else Encryption.NEVER

    @property
    def options(self) -> tuple[str, ...]:
        """How a server is told it."""
        return {Encryption.ALWAYS: ("--tls",), Encryption.NEVER: ("--no-tls",)}.get(self, ())

    def holds_for(self, connected: socket.socket) -> bool:
        """Whether this connection is to be encrypted."""
        if connected.family == socket.AF_UNIX or self is Encryption.NEVER:
            return False
        return self is Encryption.ALWAYS or not is_loopback(plain_host(connected.getpeername()[0]))
