"""Descriptors that come with messages by a Unix socket: one with each message that brings memory, none with others."""

import os
import socket
import struct

from volsplat.protocol.messages.messages import Message
from volsplat.protocol.text.errors import RemoteProtocolError

DESCRIPTOR = struct.Struct("i")  # as SCM_RIGHTS has it


def passing(descriptor: int | None) -> list[tuple[int, int, bytes]]:
    """What sendmsg takes besides bytes."""
    return [] if descriptor is None else [(socket.SOL_SOCKET, socket.SCM_RIGHTS, DESCRIPTOR.pack(descriptor))]


class ReceivedDescriptors:
    """One connection's. The caller takes that of the newest message before it receives the next."""

    def __init__(self) -> None:
        self._coming: list[int] = []  # with the message that is being received
        self._newest: list[int] = []

    def receive_into(self, wanted: memoryview, connected: socket.socket) -> int:
        """As recv_into. Raises RemoteProtocolError where more than one has come."""
        count, ancillary, _, _ = connected.recvmsg_into(
            [wanted], socket.CMSG_SPACE(DESCRIPTOR.size), socket.MSG_CMSG_CLOEXEC
        )
        for level, kind, data in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS):
                whole = len(data) - len(data) % DESCRIPTOR.size
                self._coming += [descriptor for (descriptor,) in DESCRIPTOR.iter_unpack(data[:whole])]
        if len(self._coming) > 1:
            raise RemoteProtocolError("more than one descriptor came with a message")
        return count

    def come(self, message: Message) -> None:
        """The message is whole. Raises RemoteProtocolError unless it has come with what it announces."""
        if message.brings_memory != bool(self._coming):
            fault = "lacks its" if message.brings_memory else "came with a"
            raise RemoteProtocolError(f"{type(message).__name__} {fault} descriptor")
        _close(self._newest)
        self._newest, self._coming = self._coming, []

    def take(self) -> int:
        """That of the newest message, which brings one. The caller closes it."""
        return self._newest.pop()

    def close(self) -> None:
        _close(self._newest)
        _close(self._coming)


def _close(descriptors: list[int]) -> None:
    while descriptors:
        os.close(descriptors.pop())
