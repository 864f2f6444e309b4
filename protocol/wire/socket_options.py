"""What a connection asks of its socket: no delays, an end to waiting, and not too much on the way."""

import socket
import struct

UNSENT = 256 << 10  # bytes over TCP that need not be on the way when a send returns; then it waits if the network does
ON_THE_WAY = 2 << 20  # bytes by a Unix socket, if the system allows: with more, too much is hidden when it arrives
TIMEVAL = struct.Struct("@ll")  # seconds and microseconds, as SO_SNDTIMEO takes them


def set_options(connected: socket.socket) -> None:
    if connected.family == socket.AF_UNIX:  # it delays nothing, and tells at once of a peer that is gone
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ON_THE_WAY // 2)  # Linux gives twice what is asked
        return
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_NOTSENT_LOWAT"):
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT)


def lose_after(connected: socket.socket, seconds: float) -> None:
    """Have the system give up a peer that has not taken what was sent for so long.

    Over TCP it would wait for a quarter of an hour; by a Unix socket without end.
    """
    if connected.family == socket.AF_UNIX:
        limit = TIMEVAL.pack(int(seconds), int(seconds % 1 * 1e6))
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
    elif hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1000 * seconds))
