"""What holds a port of this machine, as far as its system tells."""

from __future__ import annotations

import os
import pwd
from collections.abc import Iterator
from pathlib import Path

from volsplat.client.ui.doors.tcp_sockets import LISTENING, tcp_sockets
from volsplat.protocol.text.printable import printable

_PROCESSES = Path("/proc")
_LONGEST = 100  # characters of a command line


def port_holder(port: int) -> str:
    """Words for whoever listens at the port, with the cure if it is one's own."""
    held = next((found for found in tcp_sockets(port) if found.state == LISTENING), None)
    if held is None:
        return "something listens there already"
    for process in _processes_with(held.inode):
        return f"process {process} ({_command(process)}) listens there already; end it with `kill {process}`"
    return f"a process of {_name(held.owner)} listens there already"


def _processes_with(inode: int) -> Iterator[int]:
    """Those that have the socket open, among those that may be looked into."""
    for folder in _PROCESSES.glob("[0-9]*"):
        try:
            for entry in os.scandir(folder / "fd"):
                if os.readlink(entry.path) == f"socket:[{inode}]":
                    yield int(folder.name)
                    break
        except OSError:  # another user's, or gone
            continue


def _command(process: int) -> str:
    try:
        words = (_PROCESSES / str(process) / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    except OSError:
        return "now gone"
    return printable(" ".join(words).strip())[:_LONGEST]


def _name(user: int) -> str:
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return f"user {user}"
