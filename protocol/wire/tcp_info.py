"""What the system tells of a TCP connection: how long a word and its answer take, and whether what was sent is taken.

Linux alone tells, and of TCP alone.
"""

import socket
import struct
from typing import NamedTuple

# linux/tcp.h, struct tcp_info
MIN_RTT = struct.Struct("=148xI")  # tcpi_min_rtt, microseconds
# tcpi_retransmits, tcpi_probes, tcpi_bytes_acked. Unanswered probes take the place of sending again if nothing is under
# way, as when a firewall of this machine drops what is sent; a peer that does not read answers them.
SENT_AGAIN = struct.Struct("=2x2B116xQ")


class Delivery(NamedTuple):
    sends_again: bool  # what was lost; a peer that does not read loses nothing
    taken: int  # bytes, by the other end's system


def round_trip(connected: socket.socket) -> float:
    """Seconds, the shortest one; 0 if the system does not tell. Raises OSError."""
    (microseconds,) = _told(connected, MIN_RTT) or (0,)
    return microseconds * 1e-6


def delivery(connected: socket.socket) -> Delivery:
    """As this end's system has seen it; nothing if it does not tell. Raises OSError."""
    times, probes, taken = _told(connected, SENT_AGAIN) or (0, 0, 0)
    return Delivery(times + probes > 0, taken)


def _told(connected: socket.socket, fields: struct.Struct) -> tuple[int, ...] | None:
    if not hasattr(socket, "TCP_INFO") or connected.family == socket.AF_UNIX:
        return None
    told = connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, fields.size)
    return fields.unpack(told) if len(told) == fields.size else None  # None: an old kernel
