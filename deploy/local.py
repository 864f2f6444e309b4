"""Starts servers as processes of this machine, and ends them."""

import os
import subprocess
from types import TracebackType

from volsplat.deploy.server_command import Program, server_command

TOKEN_VARIABLE = "VOLSPLAT_TOKEN"
PATIENCE_SECONDS = 10  # that a server just started tries to reach its client
GRACE_SECONDS = 3.0  # that a server has to end by itself before it is terminated, and again before it is killed


class LocalServers:
    """The servers that a client started on its own machine.

    Each runs in a session of its own, so that Ctrl-C reaches only the client, which then ends them in order. A
    server whose client vanishes ends by itself when its control connection closes.
    """

    def __init__(self) -> None:
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self, program: Program, address: str, token: str) -> None:
        """Start one server that dials `address` (HOST:PORT)."""
        command = server_command(program, "--connect", address, "--patience", str(PATIENCE_SECONDS))
        process = subprocess.Popen(
            command,
            env={**os.environ, TOKEN_VARIABLE: token},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        self._processes.append(process)

    def ended_early(self) -> str | None:
        """A line about a server that has ended, or None while all run."""
        for process in self._processes:
            status = process.poll()
            if status is not None:
                return f"a server ended with status {status} ({' '.join(process.args[1:3])})"  # type: ignore[index]
        return None

    def stop(self) -> None:
        """End every server: wait for it, then terminate, then kill. Returns when none is left."""
        for end in (None, subprocess.Popen.terminate, subprocess.Popen.kill):
            for process in self._processes:
                if end is not None and process.poll() is None:
                    end(process)
            self._processes = [process for process in self._processes if not _ends(process)]

    def __enter__(self) -> "LocalServers":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


def _ends(process: "subprocess.Popen[bytes]") -> bool:
    try:
        process.wait(GRACE_SECONDS)
    except subprocess.TimeoutExpired:
        return False
    return True
