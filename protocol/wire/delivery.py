"""Whether what was sent over TCP is taken by the other end's system, as this one has seen it."""

import socket
import struct
from typing import NamedTuple

SENT_AGAIN = struct.Struct("=2xB117xQ")  # linux/tcp.h, struct tcp_info: tcpi_retransmits, tcpi_bytes_acked


class Delivery(NamedTuple):
    sends_again: bool  # what was lost; a peer that does not read loses nothing
    taken: int  # bytes


def delivery(connected: socket.socket) -> Delivery:
    """Nothing is known but on Linux, and of TCP. Raises OSError."""
    if not hasattr(socket, "TCP_INFO") or connected.family == socket.AF_UNIX:
        return Delivery(False, 0)
    told = connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, SENT_AGAIN.size)
    if len(told) < SENT_AGAIN.size:  # an old kernel
        return Delivery(False, 0)
    times, taken = SENT_AGAIN.unpack(told)
    return Delivery(times > 0, taken)
