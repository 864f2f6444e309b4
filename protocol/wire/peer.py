"""Who is at the other end of a connection, and what has gone over it."""

from dataclasses import dataclass

from volsplat.protocol.messages.roles import Role


@dataclass(frozen=True)
class Peer:
    """Who is at the other end. `id` is its id in the session (0 for the client), `host` and `port` its address;
    a caller by a Unix socket has no port (see unix_socket).

    `data_host` and `data_port`: where a splat server takes data links; 0 for all others. `data_anywhere`: on every
    address of its machine, of which this is the one that it was seen by.
    """

    role: Role
    host: str
    port: int
    id: int = 0
    version: int = 0
    name: str = ""
    data_host: str = ""
    data_port: int = 0
    data_anywhere: bool = False

    def __str__(self) -> str:
        number = f" {self.id}" if self.id else ""
        name = f" ({self.name})" if self.name else ""
        place = f"at {self.host}:{self.port}" if self.port else "on this machine"
        return f"{self.role}{number}{name} {place}"


@dataclass
class Counters:
    bytes_in: int = 0
    bytes_out: int = 0
    messages_in: int = 0
    messages_out: int = 0
    seconds_in_message: float = 0.0  # the newest that came, from its first bytes to its last
    seconds_in_send: float = 0.0  # blocked, because the peer did not read fast enough
