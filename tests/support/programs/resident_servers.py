"""A session whose servers a person has started by hand, each resident."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.patience import wait_until
from volsplat.client import Session
from volsplat.protocol.wire.tokens import new_token

MAPSHADE, SPLAT = "mapshade_server", "splat_server"


class Servers:
    """Their processes, by program."""

    def __init__(self, session: Session, environment: dict[str, str], directory: Path) -> None:
        self.session = session
        self.of: dict[str, list[subprocess.Popen[bytes]]] = {MAPSHADE: [], SPLAT: []}
        self._environment, self._directory = environment, directory

    def join(self, program: str) -> None:
        joined = len(self.session.servers)
        command = [sys.executable, "-m", f"volsplat.{program}", "--connect", str(self.session.address), "--resident"]
        self.of[program].append(subprocess.Popen(command, cwd=self._directory, env=self._environment))
        wait_until(lambda: len(self.session.servers) > joined, "joined")

    def end(self) -> None:
        for process in (*self.of[MAPSHADE], *self.of[SPLAT]):
            process.kill()
            process.wait()


@contextmanager
def opened(head: Path, workers: int, splat_servers: int) -> Iterator[Servers]:
    token = new_token()
    with Session(head, workers=workers, splat_servers=splat_servers, spawn=False, token=token) as session:
        servers = Servers(session, {"VOLSPLAT_TOKEN": token.key.decode()}, head.parent)
        try:
            for program, count in ((SPLAT, splat_servers), (MAPSHADE, workers)):
                for _ in range(count):
                    servers.join(program)
            yield servers
        finally:
            servers.end()
