"""What carries a connection's bytes: as they are, with descriptors by a Unix socket, or by TLS (see tls_channel)."""

import socket
from typing import Protocol

from volsplat.protocol.wire.descriptors import ReceivedDescriptors, passing


class Channel(Protocol):
    """One thread receives while another sends. The socket's timeout holds for both."""

    came: int  # bytes that the socket has given, of which some may wait here for what belongs to them

    @property
    def holds_unread(self) -> bool:
        """Whether receive_into() would give something that the socket has not any more."""

    def receive_into(self, wanted: memoryview) -> int:
        """As recv_into: how many bytes have come, 0 at the stream's end."""

    def send(self, buffers: list[memoryview], descriptor: int | None, flags: int) -> int:
        """How many bytes of `buffers` have gone, with the first of them `descriptor` where there is one.

        With MSG_DONTWAIT it raises BlockingIOError rather than wait; what is sent next begins with the same bytes.
        """

    def sealed(self, buffers: list[memoryview]) -> bytes:
        """These few bytes as the socket carries them, for whoever sends them before all that follows."""


class PlainChannel:
    """As the socket carries them, not encrypted."""

    holds_unread = False

    def __init__(self, connected: socket.socket, descriptors: ReceivedDescriptors) -> None:
        """`descriptors` takes those that come by a Unix socket."""
        self._socket = connected
        self._descriptors = descriptors if connected.family == socket.AF_UNIX else None
        self.came = 0

    def receive_into(self, wanted: memoryview) -> int:
        if self._descriptors is None:
            count = self._socket.recv_into(wanted)
        else:
            count = self._descriptors.receive_into(wanted, self._socket)
        self.came += count
        return count

    def send(self, buffers: list[memoryview], descriptor: int | None, flags: int) -> int:
        return self._socket.sendmsg(buffers, passing(descriptor), flags)

    def sealed(self, buffers: list[memoryview]) -> bytes:
        return b"".join(buffers)


def unsent(buffers: list[memoryview], count: int) -> list[memoryview]:
    """What is left of `buffers` when `count` bytes have gone."""
    for n, buffer in enumerate(buffers):
        if count < len(buffer):
            return [buffer[count:], *buffers[n + 1 :]]
        count -= len(buffer)
    return []
