"""Whose process it is that connects: on a machine with many users, loopback is open to all of them.

What an address or a cookie holds can be stolen; whose socket it is that brings it cannot be pretended. A forwarded port
(`ssh -L`) is the person's as well: sshd connects as the user who has logged in.
"""

from __future__ import annotations

import socket

from volsplat.client.ui.doors.tcp_sockets import ESTABLISHED, tcp_sockets
from volsplat.protocol.wire.addresses import LOOPBACK

ROOT = 0


class PeerOwner:
    """Tells one user's connections over loopback from those of others."""

    def __init__(self, own: int | None) -> None:
        """`own` is the user's id; None if no difference can or shall be made."""
        self._own = own

    def is_stranger(self, peer: tuple[str, int], here: tuple[str, int]) -> bool:
        """Whether another user's process, or one that is gone, holds the peer's end of a connection to `here`.

        Root is no stranger: it may do everything anyway, and forwards ports into containers.
        """
        if self._own is None:
            return False
        # Twice: the system's table is read piece by piece, and sockets that come and go meanwhile move others past.
        return all(_owner(peer, here) not in (self._own, ROOT) for _ in range(2))


def own_peers() -> PeerOwner:
    """For the user of this process, if the system tells whose sockets are.

    Root's own page is open to every user who has its secrets: in a container that shares its host's network, a root
    that is nobody in particular serves a person whose browser runs outside.
    """
    with socket.create_server((LOOPBACK, 0)) as listening:
        with socket.create_connection(listening.getsockname()) as ours:
            return PeerOwner(_owner(ours.getsockname(), ours.getpeername()) or None)


def _owner(end: tuple[str, int], other: tuple[str, int]) -> int | None:
    """The user who holds this end of an open connection, None if there is none such."""
    for found in tcp_sockets(end[1]):
        if found.state == ESTABLISHED and (found.local, found.remote) == (end, other):
            return found.owner
    return None
