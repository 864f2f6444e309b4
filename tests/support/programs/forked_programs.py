"""Programs of volsplat, forked from a process that has loaded them (command_forker.py), as whoever asks sees them."""

import json
import os
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from support.checkout import ROOT
from support.patience import PATIENCE

STAND_IN = Path(__file__).with_name("stand_in.py")
LOST = -signal.SIGKILL  # the status of what was forked by a process that is gone


class Forker:
    """Begins at once; what it is asked for meanwhile begins when all is loaded."""

    def __init__(self, forked: Literal["all", "fork-servers"]) -> None:
        """What of the programs that are started by commands is forked, too."""
        self._place = TemporaryDirectory()
        self.folder = self._place.name  # holds a `volsplat` that asks here
        self._door = f"{self.folder}/socket"
        stand_in = Path(self.folder, "volsplat")
        words = shlex.join([sys.executable, "-IS", str(STAND_IN), self._door])
        stand_in.write_text(f'#!/bin/sh\nexec {words} "$@"\n', encoding="utf-8")
        stand_in.chmod(0o700)
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(self._door)
            listener.listen()
            number = str(listener.fileno())
            self._process = subprocess.Popen(
                [sys.executable, "-m", "support.programs.command_forker", number, str(stand_in), forked],
                cwd=ROOT / "tests",
                stdin=subprocess.PIPE,
                pass_fds=[listener.fileno()],
                start_new_session=True,  # which ends the commands when this process says so, or ends
            )

    @property
    def gone(self) -> bool:
        return self._process.poll() is not None

    @contextmanager
    def held(self) -> Iterator[None]:
        """Nothing is forked meanwhile, though it is asked for."""
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def end(self) -> None:
        """And with it the commands."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(PATIENCE)  # commands that are called off end their servers
        finally:
            self._process.kill()
            self._process.wait()
            self._place.cleanup()

    def fork(
        self, words: Sequence[str], folder: Path, environment: Mapping[str, str], streams: Sequence[int]
    ) -> "Forked":
        asker = socket.socket(socket.AF_UNIX)
        asker.connect(self._door)
        data = json.dumps({"words": words, "folder": str(folder), "environment": dict(environment)}).encode()
        socket.send_fds(asker, [len(data).to_bytes(8, "big")], streams)
        asker.sendall(data)
        return Forked(asker)


class Forked:
    """A program. What it offers is what subprocess.Popen does."""

    def __init__(self, asker: socket.socket) -> None:
        self._asker = asker
        pid = self._told(PATIENCE)
        assert pid is not None, "what forks commands has ended"
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        with suppress(subprocess.TimeoutExpired):
            self.wait(0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Its status. Raises subprocess.TimeoutExpired."""
        if self.returncode is None:
            try:
                status = self._told(timeout)
            except (TimeoutError, BlockingIOError) as error:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0) from error
            self.returncode = LOST if status is None else status
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def close(self) -> None:
        """End it, however it is."""
        self.send_signal(signal.SIGKILL)
        self.wait(PATIENCE)
        self._asker.close()

    def _told(self, timeout: float | None) -> int | None:
        """A number, or None if who tells is gone."""
        self._asker.settimeout(timeout)
        data = self._asker.recv(8, socket.MSG_WAITALL)
        return int.from_bytes(data, "big", signed=True) if len(data) == 8 else None


class Begun:
    """A program that the forker of this process has forked, whose stderr can be read meanwhile."""

    def __init__(self, words: Sequence[str], folder: Path, environment: Mapping[str, str]) -> None:
        reader, writer = os.pipe()
        with open(os.devnull, "r+b") as nothing, open(writer, "wb") as stderr:
            streams = (nothing.fileno(), nothing.fileno(), stderr.fileno())
            self._forked = forker().fork(words, folder, environment, streams)
        self.stderr = open(reader, encoding="utf-8")
        self.pid = self._forked.pid
        self.send_signal, self.wait = self._forked.send_signal, self._forked.wait

    def close(self) -> None:
        """End it, however it is."""
        self._forked.close()
        self.stderr.close()


_forkers: list[Forker] = []


def forker() -> Forker:
    """That of all persons of this process, which begins with the first of them."""
    if not _forkers or _forkers[-1].gone:
        _forkers.append(Forker("fork-servers"))
    return _forkers[-1]


def end_forkers() -> None:
    while _forkers:
        _forkers.pop().end()
