"""The side that is dialled and accepts: a port that lets in peers that know the session token, and nobody else."""

from collections.abc import Callable

from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import LOOPBACK
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.port import HANDSHAKE_SECONDS, MOST_PENDING, Port
from volsplat.protocol.wire.tokens import Token


class Listener(Port):
    """A port whose callers an Accepter greets."""

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
        handshake_seconds: float = HANDSHAKE_SECONDS,
        most_pending: int = MOST_PENDING,
        encryption: Encryption = Encryption.BETWEEN_MACHINES,
    ) -> None:
        """See Accepter and Port. Raises BadInput where the address cannot be had."""
        self.accepter = Accepter(role, token, assign_id=assign_id, token_of=token_of, allocate=allocate)
        super().__init__(self.accepter.greet, host, port, handshake_seconds, most_pending, encryption)
