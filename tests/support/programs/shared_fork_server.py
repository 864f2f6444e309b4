"""One fork server for all sessions of a process that tests: each would load the servers' programs again, for half a
second."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import pytest

from volsplat.deploy import local
from volsplat.deploy.forked_servers import ForkedServer, ForkedServers
from volsplat.deploy.server_command import Program

# What servers load when they greet, and when they read what most tests have as their volumes.
LATE = ["subprocess", "encodings.ascii", "encodings.idna", "volsplat.mapshade_server.readers.medicine.nrrd"]


class _OfASession(ForkedServers):
    """What a session sees of it: ending it ends the session's servers."""

    def __init__(self, shared: ForkedServers) -> None:
        self._shared = shared
        self._started: list[ForkedServer] = []

    @property
    def gone(self) -> bool:
        return self._shared.gone

    def start(self, program: Program, arguments: Sequence[str], environment: Mapping[str, str]) -> ForkedServer:
        server = self._shared.start(program, arguments, environment)
        server.forks = self  # who ends it before it is there ends those of this session
        self._started.append(server)
        return server

    def send(self, process: int, number: int) -> None:
        self._shared.send(process, number)

    def end(self) -> None:
        """Waits for those that are not there yet."""
        for server in self._started:
            if server.returncode is None and server.pid:
                server.kill()


class _Lender:
    def __init__(self) -> None:
        self._shared: ForkedServers | None = None

    def lend(self) -> ForkedServers:
        if self._shared is None or self._shared.gone:
            self.end()
            self._shared = ForkedServers(LATE)
        return _OfASession(self._shared)

    def end(self) -> None:
        if self._shared is not None:
            self._shared.end()


@contextmanager
def shared_fork_server() -> Iterator[None]:
    """Sessions that are opened meanwhile start their servers by it. It begins with the first of them."""
    lender = _Lender()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local, "forked_servers", lender.lend)
        yield
    lender.end()
