"""A shell whose `volsplat` begins at once."""

import os
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from types import TracebackType
from typing import Self

from support.checkout import ROOT
from support.patience import PATIENCE

STAND_IN = Path(__file__).with_name("stand_in.py")


class QuickShell:
    """Runs scripts in a folder. What `volsplat` loads is loaded once, in a process that each command is forked from."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._place = TemporaryDirectory()
        stand_in = Path(self._place.name, "volsplat")
        path = f"{self._place.name}:{Path(sys.executable).parent}:{environment['PATH']}"
        self._environment = {**environment, "PATH": path}
        door = f"{self._place.name}/socket"
        words = shlex.join([sys.executable, "-IS", str(STAND_IN), door])
        stand_in.write_text(f'#!/bin/sh\nexec {words} "$@"\n', encoding="utf-8")
        stand_in.chmod(0o700)
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(door)
            listener.listen()
            self._forker = subprocess.Popen(
                [sys.executable, "-m", "support.programs.command_forker", str(listener.fileno()), str(stand_in)],
                cwd=ROOT / "tests",
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
                start_new_session=True,  # which ends the commands when this process says so, or ends
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._forker.stdin is not None
        self._forker.stdin.close()
        try:
            self._forker.wait(PATIENCE)  # commands that are called off end their servers
        finally:
            self._forker.kill()
            self._forker.wait()
            self._place.cleanup()

    def runs(self, script: str, limit: float, folder: Path | None = None) -> "subprocess.CompletedProcess[str]":
        """A script, as bash runs it until a command fails. Raises subprocess.TimeoutExpired after so many seconds."""
        with TemporaryFile("w+", encoding="utf-8") as said:  # a pipe ends only with all who have it
            shell = subprocess.Popen(
                ["bash", "-e", "-c", script],
                cwd=folder or self._folder,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
            try:
                status = shell.wait(limit)
            finally:
                if shell.returncode is None:
                    os.killpg(shell.pid, signal.SIGKILL)  # and who waits in it for a command, which ends then
                    shell.wait()
            said.seek(0)
            return subprocess.CompletedProcess(script, status, said.read())
