"""What a connection asks of its socket: no delays, news of a peer that is gone, and not too much on the way."""

import socket

KEEPALIVE_IDLE_SECONDS = 10  # a silent peer is asked after this; one whose machine is gone is noticed …
KEEPALIVE_INTERVAL_SECONDS = 5
KEEPALIVE_PROBES = 3  # … this many unanswered questions later
UNSENT = 256 << 10  # bytes over TCP that need not be on the way when a send returns; then it waits if the network does
ON_THE_WAY = 2 << 20  # bytes by a Unix socket, if the system allows: with more, too much is hidden when it arrives


def set_options(connected: socket.socket) -> None:
    if connected.family == socket.AF_UNIX:  # it delays nothing, and tells at once of a peer that is gone
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ON_THE_WAY // 2)  # Linux gives twice what is asked
        return
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (
        ("TCP_KEEPIDLE", KEEPALIVE_IDLE_SECONDS),
        ("TCP_KEEPINTVL", KEEPALIVE_INTERVAL_SECONDS),
        ("TCP_KEEPCNT", KEEPALIVE_PROBES),
        ("TCP_NOTSENT_LOWAT", UNSENT),
    ):
        if hasattr(socket, name):  # macOS has no TCP_KEEPIDLE
            connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
