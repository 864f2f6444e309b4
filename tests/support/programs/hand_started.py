"""Servers that a person has started by hand, each in a folder of its own."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import SystemRandom

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.protocol.wire.tokens import new_token

BELOW_CONNECTIONS = 16384, 32768  # Linux gives those above to connections
TOGETHER = 8  # ports, as servers that wait take one after the other


def free_port() -> int:
    """One that is free like those after it, and that the system gives to no connection meanwhile."""
    while True:
        first = SystemRandom().randrange(*BELOW_CONNECTIONS, TOGETHER)
        with suppress(OSError), ExitStack() as held:
            for port in range(first, first + TOGETHER):
                held.enter_context(socket.create_server(("127.0.0.1", port)))
            return first


@contextmanager
def joined_by_hand(folders: list[Path], volume: str) -> Iterator[Session]:
    """A session whose servers were started in these folders, one after the other, the splat server in the last."""
    token = new_token()
    programs: list[subprocess.Popen[bytes]] = []
    with Session(volume, workers=len(folders), spawn=False, token=token) as session:
        try:
            modules = ["volsplat.mapshade_server"] * len(folders) + ["volsplat.splat_server"]
            for module, folder in zip(modules, [*folders, folders[-1]], strict=True):
                command = [sys.executable, "-m", module, "--connect", str(session.address)]
                programs.append(subprocess.Popen(command, cwd=folder, env={"VOLSPLAT_TOKEN": token.key.decode()}))
                wait_until(lambda: len(session.servers) == len(programs), "joined")
            yield session
        finally:
            session.close()
            for program in programs:
                program.wait(PATIENCE)
