"""The fork server: has loaded the servers' programs, and becomes as many servers as it is asked for, each at once.

    python -m volsplat.deploy.fork_server [MODULE…]

The modules are loaded as well, once for all servers.
Its standard input is a socket to who started it, over which go lines of JSON: `Start` and `Signal` one way, `Started`,
`Refused` and `Ended` the other. It has no threads, and ends when the other side does.
"""

import os
import runpy
import selectors
import signal
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module

import msgspec

from volsplat.deploy.server_command import Program
from volsplat.program.many_imports import many_imports

STDIN = 0
LINE_BYTES = 1 << 16  # read at once


class Start(msgspec.Struct, tag=True):
    program: Program
    arguments: list[bytes]
    environment: dict[bytes, bytes]


class Signal(msgspec.Struct, tag=True):
    """To a server that has not been told of as ended: only who waits for it knows that its id is no other's."""

    process: int
    number: int


class Started(msgspec.Struct, tag=True):
    """The answer to each Start, in their order."""

    process: int


class Refused(msgspec.Struct, tag=True):
    """The other answer: the system has no process to give."""

    errno: int


class Ended(msgspec.Struct, tag=True):
    process: int
    status: int  # as subprocess tells it


class Lines:
    """Cuts what comes into lines."""

    def __init__(self) -> None:
        self._rest = b""

    def fed(self, data: bytes) -> list[bytes]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        return lines


class ForkServer:
    """`serve` returns in each server, with what that is to run; in the fork server itself None, at the end."""

    def __init__(self, link: socket.socket) -> None:
        self._link = link
        self._lines = Lines()
        self._running: set[int] = set()
        # Signals are noted there, so that waiting for lines ends when a server does.
        self._wakes, self._woken = socket.socketpair()
        for end in (self._wakes, self._woken):
            end.setblocking(False)

    def serve(self) -> Callable[[], object] | None:
        signal.set_wakeup_fd(self._woken.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        with selectors.DefaultSelector() as ready:
            ready.register(self._link, selectors.EVENT_READ)
            ready.register(self._wakes, selectors.EVENT_READ)
            while True:
                for key, _ in ready.select():
                    if key.fileobj is self._wakes:
                        self._tell_ends()
                        continue
                    if not (data := self._heard()):
                        return None
                    for line in self._lines.fed(data):
                        asked = msgspec.json.decode(line, type=Start | Signal)
                        if isinstance(asked, Signal):
                            if asked.process in self._running:
                                os.kill(asked.process, asked.number)
                        elif self._is_server():
                            return partial(_run, asked)

    def _heard(self) -> bytes:
        """What has come; nothing once the other side has ended, maybe before it read what it was told."""
        try:
            return self._link.recv(LINE_BYTES)
        except ConnectionResetError:
            return b""

    def _is_server(self) -> bool:
        """Fork; in the new process everything is let go that is the fork server's."""
        try:
            process = os.fork()
        except OSError as error:
            self._tell(Refused(error.errno or 0))
            return False
        if process:
            self._running.add(process)
            self._tell(Started(process))
            return False
        os.setpgid(0, 0)
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for end in (self._link, self._wakes, self._woken):
            end.close()
        return True

    def _tell_ends(self) -> None:
        with suppress(BlockingIOError):
            self._wakes.recv(LINE_BYTES)
        while self._running:
            process, status = os.waitpid(-1, os.WNOHANG)
            if not process:
                return
            self._running.remove(process)
            self._tell(Ended(process, os.waitstatus_to_exitcode(status)))

    def _tell(self, message: Started | Refused | Ended) -> None:
        with suppress(OSError):  # nobody is there any more, which ends this
            self._link.sendall(msgspec.json.encode(message) + b"\n")


def _run(asked: Start) -> None:
    os.environ.clear()
    os.environb.update(asked.environment)
    sys.argv[1:] = map(os.fsdecode, asked.arguments)
    runpy.run_module(asked.program.value, run_name="__main__", alter_sys=True)


def main() -> None:
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # some terminals stop what speaks up in the background
    link = socket.socket(fileno=os.dup(STDIN))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, STDIN)  # of the servers
    os.close(nothing)
    with many_imports():
        for module in (*(f"{program.value}.command" for program in Program), *sys.argv[1:]):
            with suppress(Exception):  # the server tells why it cannot be loaded
                import_module(module)
    if run := ForkServer(link).serve():
        run()
    os._exit(0)  # to take down what was loaded, though nothing was said or written, takes a tenth of a second


if __name__ == "__main__":
    main()
