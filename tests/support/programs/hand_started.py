"""Servers that a person has started by hand, each in a folder of its own."""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.protocol.wire.tokens import new_token


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


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
