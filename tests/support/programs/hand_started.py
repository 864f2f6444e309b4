"""Servers that a person has started by hand, each in a folder of its own."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volsplat.client import Session
from volsplat.protocol.wire.tokens import new_token

PATIENCE = 60.0  # seconds after which what never comes fails its test


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
            for n, (module, folder) in enumerate(zip(modules, [*folders, folders[-1]], strict=True)):
                command = [sys.executable, "-m", module, "--connect", str(session.address)]
                programs.append(subprocess.Popen(command, cwd=folder, env={"VOLSPLAT_TOKEN": token.key.decode()}))
                deadline = time.monotonic() + PATIENCE
                while len(session.servers) <= n:
                    assert time.monotonic() < deadline
                    time.sleep(0.01)
            yield session
        finally:
            session.close()
            for program in programs:
                program.wait(PATIENCE)
