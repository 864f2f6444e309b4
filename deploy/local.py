"""Starts servers as processes of this machine, starts another one where one has ended, and ends them."""

import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from volsplat.deploy.forked_servers import ForkedServer, ForkedServers, forked_servers
from volsplat.deploy.process_end import NEVER_BEGAN, told_end
from volsplat.deploy.restart_limit import RestartLimit
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token

PATIENCE_SECONDS = 1  # that a server just started tries to reach its client, which listens before it starts any
REAPED_SECONDS = 1.0  # until it is known how a process ended whose connections are gone, on a busy machine
BAD_INPUT = 2  # the status of a server that ends since a person must act
USELESS_AGAIN = (BAD_INPUT, *NEVER_BEGAN)  # another one would end alike
GRACE_SECONDS = 0.5  # that servers have to end by themselves before they are terminated, and again before a kill


@dataclass
class _Place:
    """One server, whichever process is it now."""

    program: Program
    arguments: list[str]
    environment: dict[str, str]
    restarts: RestartLimit = field(default_factory=RestartLimit)


class LocalServers:
    """The servers that a client started on its own machine.

    Each runs in a process group of its own, so that Ctrl-C reaches only the client, which then ends them in order; and
    in the client's session, since systems may share out a core among sessions first: servers in sessions of their own
    would each get as much of it as the browser. A server whose client vanishes ends by itself when its control
    connection closes. In the place of one that ends before that, another one is started. `on_end` is called, on a
    thread of its own, for each server that ends: with one line, its name (see process_name), and whether another one is
    started in its place.
    """

    def __init__(
        self,
        on_end: Callable[[str, str, bool], None],
        silence: float = SILENCE_SECONDS,
        encryption: Encryption = Encryption.BETWEEN_MACHINES,
    ) -> None:
        self._on_end = on_end
        self._silence = silence
        self._encryption = encryption
        self._lock = threading.Lock()  # guards what follows
        self._forks: ForkedServers | None = None
        self._processes: list[ForkedServer] = []
        self._useless: set[str] = set()  # names of those that were ended here
        self._ending = False

    def start(self, program: Program, address: str, token: Token, threads: int, options: Sequence[str] = ()) -> None:
        """Start one server that dials `address` (HOST:PORT) and may use so many threads, with more `options`."""
        limits = ("--patience", str(PATIENCE_SECONDS), "--silence", str(self._silence), "--threads", str(threads))
        arguments = ["--connect", address, *limits, *options, *self._encryption.options]
        with self._lock:
            self._start(_Place(program, arguments, token.added_to(os.environ)))

    def _start(self, place: _Place) -> None:
        if self._forks is not None and self._forks.gone:
            self._forks.end()
            self._forks = None
        self._forks = self._forks or forked_servers()
        process = self._forks.start(place.program, place.arguments, place.environment)
        self._processes.append(process)
        threading.Thread(
            target=self._watch, args=(place, process), name=f"watch {place.program.title}", daemon=True
        ).start()

    @property
    def process_ids(self) -> list[int]:
        """Of those that have not ended, as far as is known."""
        return [process.pid for process in list(self._processes) if process.returncode is None and process.pid]

    def _watch(self, place: _Place, process: ForkedServer) -> None:
        status = process.wait()
        again = self._started_again(place, status)
        another = "; another one is started in its place" if again else ""
        which = f" (process {process.pid})" if process.pid else ""
        self._on_end(f"the {place.program.title}{which} {told_end(status)}{another}", _name(process), again)

    def _started_again(self, place: _Place, status: int) -> bool:
        with self._lock:
            if self._ending or status in USELESS_AGAIN or not place.restarts.may_restart():
                return False
            try:
                self._start(place)
            except (OSError, RuntimeError):  # the system has no process or thread left to give
                return False
            return True

    def has(self, name: str) -> bool:
        """Whether the server of this name (see process_name) was started here."""
        return name in self._here()

    def end(self, name: str) -> None:
        """The server of this name, if it was started here, is of no use any more, and may be frozen: another one is."""
        process = self._here().get(name)
        if process is not None and not self._ending:
            self._useless.add(name)
            process.kill()

    def _here(self) -> dict[str, ForkedServer]:
        return {_name(process): process for process in list(self._processes)}

    def told_ends(self, names: Iterable[str]) -> dict[str, str]:
        """How the servers of these names (see process_name) ended, of those that were started and not ended here.

        Waits a moment: a process is gone a little later than its connections.
        """
        here = self._here()
        asked = [name for name in names if name in here]
        deadline = time.monotonic() + REAPED_SECONDS
        ended = [name for name in asked if _ended_by(deadline, here[name])]
        return {name: told_end(here[name].wait()) for name in ended if name not in self._useless}

    def let_end(self) -> None:
        """From now on none is started in the place of one that ends."""
        with self._lock:
            self._ending = True

    def stop(self) -> None:
        """End every server: wait for them, then terminate, then kill. Returns when none is left."""
        self.let_end()
        for end in (None, ForkedServer.terminate, ForkedServer.kill):
            for process in self._processes:
                if end is not None and process.returncode is None:
                    end(process)
            deadline = time.monotonic() + GRACE_SECONDS
            if all([_ended_by(deadline, process) for process in self._processes]):
                break
        if self._forks is not None:
            self._forks.end()


def _name(process: ForkedServer) -> str:
    return f"{socket.gethostname()}, process {process.pid}"


def _ended_by(deadline: float, process: ForkedServer) -> bool:
    """Whether the process has ended at a moment of time.monotonic()."""
    try:
        process.wait(max(0.0, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        return False
    return True


def shared_out(threads: int, servers: int) -> list[int]:
    """Threads for each server, of so many for all of them; each has one at least."""
    return [max(1, (threads + n) // servers) for n in range(servers)]
