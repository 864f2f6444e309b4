"""A shell whose `volsplat` begins at once."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType
from typing import Self

from support.programs.forked_programs import Forker


class QuickShell:
    """Runs scripts in a folder. What `volsplat` loads is loaded once, in a process that each command is forked from."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._forker = Forker("all")
        path = f"{self._forker.folder}:{Path(sys.executable).parent}:{environment['PATH']}"
        self._environment = {**environment, "PATH": path}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._forker.end()

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
