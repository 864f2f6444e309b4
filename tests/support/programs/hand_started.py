"""Servers that a person has started by hand, each in a folder of its own."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import SystemRandom

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.protocol.wire.tokens import Token, new_token

BELOW_CONNECTIONS = 16384, 32768  # Linux gives those above to connections
TOGETHER = 8  # ports, as servers that wait take one after the other


# Of those who test side by side each has ports of its own: what is free may not be in use yet.
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_given: set[int] = set()


def free_port() -> int:
    """One that is free like those after it, that no other test has been given, nor the system gives to a connection."""
    begin, end = BELOW_CONNECTIONS
    ours = range(begin + WORKER * TOGETHER, end - TOGETHER, WORKERS * TOGETHER)
    while True:
        first = SystemRandom().choice([port for port in ours if port not in _given])
        _given.add(first)
        with suppress(OSError), ExitStack() as held:
            for port in range(first, first + TOGETHER):
                held.enter_context(socket.create_server(("", port)))
            return first


@contextmanager
def joined_by_hand(folders: list[Path], volume: str) -> Iterator[Session]:
    """A session whose map/shade servers run in these folders, asked in this order; the splat server in the last."""
    with Session(volume, workers=len(folders), spawn=False, token=(token := new_token())) as session:
        options = ["--connect", str(session.address)]
        workers = [_Started("volsplat.mapshade_server", options, token) for _ in folders]
        workers.sort(key=lambda worker: str(worker.program.pid))  # a client asks by their names, 10000 before 9999
        started = [*workers, _Started("volsplat.splat_server", options, token)]
        try:
            for server, folder in zip(started, [*folders, folders[-1]], strict=True):
                server.join(session, folder)
            yield session
        finally:
            session.close()
            for server in started:
                server.end()


class _Started:
    """A process that becomes a server once it hears which folder to run in."""

    def __init__(self, module: str, options: list[str], token: Token) -> None:
        shell = ["sh", "-c", 'read -r folder && cd "$folder" && exec "$@"', "sh"]
        self.program = subprocess.Popen(
            [*shell, sys.executable, "-m", module, *options],
            stdin=subprocess.PIPE,
            env={"VOLSPLAT_TOKEN": token.key.decode()},
            text=True,
        )

    def join(self, session: Session, folder: Path) -> None:
        assert self.program.stdin is not None
        before = len(session.servers)
        print(folder, file=self.program.stdin, flush=True)
        wait_until(lambda: len(session.servers) > before, "joined")

    def end(self) -> None:
        assert self.program.stdin is not None
        self.program.stdin.close()
        self.program.wait(PATIENCE)
