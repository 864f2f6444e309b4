"""Runs the real command as a person would, and looks for servers that it left behind."""

import os
import secrets
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryFile

import psutil

from support.patience import PATIENCE
from support.programs.forked_programs import Begun, forker
from support.programs.process_marks import is_marked
from support.programs.server_processes import is_server

VOLSPLAT = Path(sys.executable).parent / "volsplat"
SERVERS = ("mapshade_server", "splat_server")


class Person:
    """Someone at a keyboard in a folder, with a session token of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.token = secrets.token_urlsafe(32)

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "VOLSPLAT_TOKEN": self.token}

    def runs(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """The command in a process of its own, whose modules were loaded before it was forked."""
        with open(os.devnull, "rb") as nothing, TemporaryFile() as out, TemporaryFile() as err:
            streams = (nothing.fileno(), out.fileno(), err.fileno())
            with closing(forker().fork(arguments, self.folder, self.environment, streams)) as process:
                status = process.wait(PATIENCE)
            for said in (out, err):
                said.seek(0)
            words = ["volsplat", *arguments]
            done = subprocess.CompletedProcess(words, status, out.read().decode(), err.read().decode())
            assert status != -signal.SIGKILL, done
            return done

    def begins(self, *arguments: str) -> Begun:
        """The command, as `runs` runs it, whose stderr can be read meanwhile."""
        return Begun(arguments, self.folder, self.environment)

    def starts(self, *arguments: str) -> "subprocess.Popen[str]":
        """The command as a shell starts it."""
        return subprocess.Popen(
            [str(VOLSPLAT), *arguments],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )

    def servers(self) -> list[psutil.Process]:
        """The servers that run with this person's token."""
        found = []
        for process in psutil.process_iter():
            try:
                if any(is_server(process, program) for program in SERVERS):
                    marked = process.environ().get("VOLSPLAT_TOKEN") == self.token or is_marked(process.pid, self.token)
                    if marked and process.is_running():
                        found.append(process)
            except psutil.NoSuchProcess:
                continue
        return found


def is_under_way(command: "subprocess.Popen[str]") -> bool:
    """Whether what `Person.starts` has started has begun: before, Python itself would answer to a signal."""
    return command.poll() is not None or "msgspec" in Path(f"/proc/{command.pid}/maps").read_text(encoding="utf-8")
