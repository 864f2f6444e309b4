"""Which links are encrypted: those between machines, unless people have it otherwise at both ends."""

import ipaddress
import socket
from enum import Enum


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
        return self is Encryption.ALWAYS or not _is_loopback(connected.getpeername()[0])


def _is_loopback(host: str) -> bool:
    address = ipaddress.ip_address(host.partition("%")[0])
    mapped = getattr(address, "ipv4_mapped", None)
    return bool((mapped or address).is_loopback)
