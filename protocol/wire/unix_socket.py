"""A second way in for callers on this machine: a Unix socket beside a listener's loopback port.

It is the same protocol, at half of what TCP costs. Its name is derived from the user and the port, and is no file: it
goes with the socket. Only Linux has such names; elsewhere, and where anything is amiss, callers come by the port.
"""

import logging
import os
import socket
import struct
import sys
from contextlib import ExitStack

from volsplat.protocol.wire.addresses import LOOPBACK, Address

CREDENTIALS = struct.Struct("3i")  # process, user and group, as SO_PEERCRED gives them

log = logging.getLogger(__name__)


def opened_door(address: Address, backlog: int) -> socket.socket | None:
    """A listening socket beside the port of a listener; None where there cannot be one."""
    if not _may_have_door(address):
        return None
    try:
        with ExitStack() as unless_opened:
            door = unless_opened.enter_context(socket.socket(socket.AF_UNIX))
            door.bind(_name(address))
            door.listen(backlog)
            unless_opened.pop_all()
            return door
    except OSError as error:
        log.debug("callers on this machine come to %s by its port: %s", address, error)
    return None


def entered_door(address: Address, seconds: float) -> socket.socket | None:
    """A connection to the listener at `address` through its door; None where it is to be called by its port.

    The socket has a timeout of so many seconds, as one that came by the port would.
    """
    if not _may_have_door(address):
        return None
    try:
        with ExitStack() as unless_entered:
            caller = unless_entered.enter_context(socket.socket(socket.AF_UNIX))
            caller.settimeout(seconds)  # without one, a crowd at the door would be waited for without end
            caller.connect(_name(address))
            if is_ours(caller):
                unless_entered.pop_all()
                return caller
    except OSError as error:
        log.debug("%s is called by its port: %s", address, error)
    return None


def _may_have_door(address: Address) -> bool:
    return sys.platform == "linux" and address.host == LOOPBACK


def _name(address: Address) -> bytes:
    return f"\0volsplat {os.geteuid()} {address}".encode()


def is_ours(connected: socket.socket) -> bool:
    """Whether the other end is of this user: others see the name as well, may take it, and may call."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
    _, user, _ = CREDENTIALS.unpack(credentials)
    return bool(user == os.geteuid())
