"""How long a word and its answer take over a TCP connection, as the system has measured it."""

import socket
import struct

MIN_RTT = struct.Struct("=148xI")  # linux/tcp.h, struct tcp_info: tcpi_min_rtt, microseconds


def round_trip(connected: socket.socket) -> float:
    """Seconds, the shortest one; 0 if the system does not tell, as it does on Linux alone. Raises OSError."""
    if not hasattr(socket, "TCP_INFO") or connected.family == socket.AF_UNIX:
        return 0.0
    told = connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, MIN_RTT.size)
    if len(told) < MIN_RTT.size:  # an old kernel
        return 0.0
    microseconds: int = MIN_RTT.unpack(told)[0]
    return microseconds * 1e-6
