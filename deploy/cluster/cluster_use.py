"""The use of a cluster: one client has it at a time, of all that share its folder.

Who waits says for whom. Who ends, in whatever way, makes room.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from contextlib import suppress
from io import FileIO
from pathlib import Path
from weakref import WeakValueDictionary

import msgspec

from volsplat.deploy.cluster.file_lock import EXCLUSIVE, give_back, taken
from volsplat.deploy.cluster.state import StateFolder
from volsplat.deploy.launchers.launcher import Report
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

PATIENCE_SECONDS = 60.0  # with who has it
LOOK_SECONDS = 0.1
OWN_COMMAND = "volsplat"


class Holder(msgspec.Struct, frozen=True):
    """Who has it, for people: in another container another process may be called alike."""

    command: str
    process: int
    host: str
    since: str  # the time of day there

    @staticmethod
    def this_process() -> Holder:
        return Holder(_command(), os.getpid(), socket.gethostname(), time.strftime("%H:%M:%S"))

    def __str__(self) -> str:
        where = "" if self.host == socket.gethostname() else f" on {self.host}"
        return printable(f"{self.command} (process {self.process}{where}, since {self.since})")


class ClusterUse:
    """One client's. It ends with the process at the latest."""

    def __init__(self, folder: StateFolder) -> None:
        """`folder` is the cluster's."""
        self._folder = folder
        self._file: FileIO | None = None  # closed by Python if nobody ends the use of a client that has failed
        self.since = ""  # the time of day

    def take(self, report: Report) -> None:
        """Wait until this client has it. Raises BadInput, which names who keeps it."""
        file = FileIO(self._folder.opened("client"), "r+b")
        try:
            self._wait(file.fileno(), report)
            holder = Holder.this_process()
            with suppress(OSError):  # the disk is full: nobody hears who it is
                file.truncate(0)
                file.write(msgspec.json.encode(holder))
        except BaseException:
            file.close()
            raise
        self._file, self.since = file, holder.since
        _own[self._key] = self

    def end(self) -> None:
        """May be called again, and where it was never taken."""
        file, self._file = self._file, None
        if file is not None:
            _own.pop(self._key, None)
            with suppress(OSError):  # whoever has it next writes over it
                file.truncate(0)
            give_back(file.fileno())
            file.close()

    @property
    def _key(self) -> tuple[int, Path]:
        return os.getpid(), self._folder.path

    def _wait(self, descriptor: int, report: Report) -> None:
        name, told = self._folder.path.name, ""
        give_up_at = time.monotonic() + PATIENCE_SECONDS
        while not self._taken(descriptor):
            if (own := _own.get(self._key)) is not None:
                raise BadInput(f"this process uses the cluster {name} already, since {own.since}; close that first")
            holder = _holder(descriptor)
            who = "another client" if holder is None else str(holder)
            if time.monotonic() > give_up_at:
                raise BadInput(f"the cluster {name} serves {who}; end that one, or try again once it has ended")
            if who != told:
                report(f"waiting for {who}, which the cluster {name} serves")
                told = who
            time.sleep(LOOK_SECONDS)

    def _taken(self, descriptor: int) -> bool:
        try:
            return taken(descriptor, EXCLUSIVE)
        except OSError as error:
            raise self._folder.unusable("locked", error) from error


_own: WeakValueDictionary[tuple[int, Path], ClusterUse] = WeakValueDictionary()  # a forked process has none of them


def _holder(descriptor: int) -> Holder | None:
    """None for the moment that it takes to say so, and where the disk is full."""
    try:
        return msgspec.json.decode(os.pread(descriptor, 1 << 16, 0), type=Holder)
    except (OSError, msgspec.DecodeError):
        return None


def _command() -> str:
    """What a person knows this process by; words of a script of theirs are left out."""
    program = Path(sys.argv[0]).name if sys.argv else "a script"
    return " ".join([program, *sys.argv[1:2]]) if program == OWN_COMMAND else program
