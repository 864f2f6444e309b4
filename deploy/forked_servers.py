"""Servers that a fork server becomes, as whoever started it sees them."""

import atexit
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress

import msgspec

from volsplat.deploy.fork_server import Ended, Lines, Refused, Signal, Start, Started
from volsplat.deploy.process_end import WITH_ITS_STARTER, never_began
from volsplat.deploy.server_command import Program
from volsplat.program.blas_threads import NO_MORE_THREADS

FORK_SERVER = "volsplat.deploy.fork_server"
COMMAND: tuple[str, ...] = (sys.executable, "-m", FORK_SERVER)


class ForkedServer:
    """One server. What it offers is what subprocess.Popen does."""

    def __init__(self, forks: "ForkedServers") -> None:
        self.forks = forks
        self._known, self._ended = threading.Event(), threading.Event()
        self._pid = 0
        self.returncode: int | None = None

    @property
    def pid(self) -> int:
        """Waits for the fork server to be there; 0 if it never was."""
        self._known.wait()
        return self._pid

    def wait(self, timeout: float | None = None) -> int:
        """Raises subprocess.TimeoutExpired."""
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired(FORK_SERVER, timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def terminate(self) -> None:
        self._end(signal.SIGTERM)

    def kill(self) -> None:
        self._end(signal.SIGKILL)

    def _end(self, number: int) -> None:
        if not self._known.is_set():  # the fork server is still loading
            self.forks.end()
        elif self.returncode is None:
            self.forks.send(self._pid, number)

    def has_started(self, process: int) -> None:
        self._pid = process
        self._known.set()

    def has_ended(self, status: int) -> None:
        self.returncode = status
        self._known.set()
        self._ended.set()


class ForkedServers:
    """A fork server, and the servers that it has become."""

    def __init__(self, modules: Sequence[str] = ()) -> None:
        """The servers find these modules loaded. Raises OSError if the system has no process to give."""
        self._link, theirs = socket.socketpair()
        self._lock = threading.Lock()  # guards asking, so that answers come in the same order
        self._asked: queue.SimpleQueue[ForkedServer] = queue.SimpleQueue()
        self._servers: dict[int, ForkedServer] = {}  # those that run; the hearing thread's
        self._gone = False
        with theirs:
            threading.Thread(target=self._hear, name="hear the fork server", daemon=True).start()
            self._process = subprocess.Popen(
                [*COMMAND, *modules],
                env=os.environ | NO_MORE_THREADS,
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                process_group=0,
            )

    @property
    def gone(self) -> bool:
        """Whether nothing can be started here any more."""
        return self._gone

    def start(self, program: Program, arguments: Sequence[str], environment: Mapping[str, str]) -> ForkedServer:
        """Start a server; it may take a moment until it has an id. Raises OSError if the fork server is gone."""
        server = ForkedServer(self)
        with self._lock:
            if self._gone:
                raise OSError("the fork server is gone")
            self._asked.put(server)
            named = {os.fsencode(name): os.fsencode(value) for name, value in environment.items()}
            self._say(Start(program, list(map(os.fsencode, arguments)), named))
        return server

    def send(self, process: int, number: int) -> None:
        with self._lock, suppress(OSError):  # the fork server is gone, and with it the servers
            self._say(Signal(process, number))

    def end(self) -> None:
        """End the fork server, and with it servers that still run."""
        self._process.kill()
        self._process.wait()

    def _say(self, message: Start | Signal) -> None:
        self._link.sendall(msgspec.json.encode(message) + b"\n")

    def _hear(self) -> None:
        lines = Lines()
        with suppress(OSError):
            while data := self._link.recv(1 << 16):
                for line in lines.fed(data):
                    told = msgspec.json.decode(line, type=Started | Refused | Ended)
                    if isinstance(told, Started):
                        server = self._servers[told.process] = self._asked.get()
                        server.has_started(told.process)
                    elif isinstance(told, Refused):
                        self._asked.get().has_ended(never_began(told.errno))
                    else:
                        self._servers.pop(told.process).has_ended(told.status)
        self._end_all()

    def _end_all(self) -> None:
        """How servers end is not known any more, so that they must."""
        with self._lock:
            self._gone = True
        self._link.close()
        for process, server in self._servers.items():
            if process > 0:  # any other number is that of many processes
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            server.has_ended(WITH_ITS_STARTER)
        while not self._asked.empty():
            self._asked.get().has_ended(WITH_ITS_STARTER)


_ahead: list[ForkedServers] = []


def begin_ahead(modules: Sequence[str] = ()) -> None:
    """Have a fork server load the programs, and more modules that its servers will need, for whoever asks first.

    It does so while this process loads its own.
    """
    _ahead.append(ForkedServers(modules))
    atexit.register(_end_unused)


def forked_servers() -> ForkedServers:
    """A fork server that nobody else uses. Raises OSError if the system has no process to give."""
    return _ahead.pop() if _ahead else ForkedServers()


def _end_unused() -> None:
    while _ahead:
        _ahead.pop().end()
