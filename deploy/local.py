"""Starts servers as processes of this machine, and ends them."""

import os
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterable

from volsplat.deploy.process_end import told_end
from volsplat.deploy.server_command import Program, server_command
from volsplat.protocol.wire.heartbeat import SILENCE_SECONDS
from volsplat.protocol.wire.tokens import Token

PATIENCE_SECONDS = 1  # that a server just started tries to reach its client, which listens before it starts any
REAPED_SECONDS = 1.0  # until it is known how a process ended whose connections are gone, on a busy machine
GRACE_SECONDS = 0.5  # that servers have to end by themselves before they are terminated, and again before a kill


class LocalServers:
    """The servers that a client started on its own machine.

    Each runs in a session of its own, so that Ctrl-C reaches only the client, which then ends them in order. A
    server whose client vanishes ends by itself when its control connection closes. `on_end` is called, on a thread
    of its own, with one line for each server that ends.
    """

    def __init__(self, on_end: Callable[[str], None], silence: float = SILENCE_SECONDS) -> None:
        self._on_end = on_end
        self._silence = silence
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self, program: Program, address: str, token: Token, threads: int) -> None:
        """Start one server that dials `address` (HOST:PORT) and may use so many threads."""
        limits = ("--patience", str(PATIENCE_SECONDS), "--silence", str(self._silence), "--threads", str(threads))
        process = subprocess.Popen(
            server_command(program, "--connect", address, *limits),
            env=token.added_to(os.environ),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._processes.append(process)
        threading.Thread(
            target=self._watch, args=(program, process), name=f"watch {program.title}", daemon=True
        ).start()

    @property
    def process_ids(self) -> list[int]:
        return [process.pid for process in self._processes]

    def _watch(self, program: Program, process: "subprocess.Popen[bytes]") -> None:
        status = process.wait()
        self._on_end(f"the {program.title} (process {process.pid}) {told_end(status)}")

    def told_ends(self, names: Iterable[str]) -> dict[str, str]:
        """How the servers of these names (see process_name) ended, of those that were started here and have.

        Waits a moment: a process is gone a little later than its connections.
        """
        here = {f"{socket.gethostname()}, process {process.pid}": process for process in self._processes}
        asked = [name for name in names if name in here]
        deadline = time.monotonic() + REAPED_SECONDS
        return {name: told_end(here[name].returncode) for name in asked if _ended_by(deadline, here[name])}

    def stop(self) -> None:
        """End every server: wait for them, then terminate, then kill. Returns when none is left."""
        for end in (None, subprocess.Popen.terminate, subprocess.Popen.kill):
            for process in self._processes:
                if end is not None and process.poll() is None:
                    end(process)
            deadline = time.monotonic() + GRACE_SECONDS
            if all([_ended_by(deadline, process) for process in self._processes]):
                return


def _ended_by(deadline: float, process: "subprocess.Popen[bytes]") -> bool:
    """Whether the process has ended at a moment of time.monotonic()."""
    try:
        process.wait(max(0.0, deadline - time.monotonic()))
    except subprocess.TimeoutExpired:
        return False
    return True


def shared_out(threads: int, servers: int) -> list[int]:
    """Threads for each server, of so many for all of them; each has one at least."""
    return [max(1, (threads + n) // servers) for n in range(servers)]
