"""Runs the real command as a person would, and looks for servers that it left behind."""

import os
import secrets
import subprocess
import sys
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

import psutil

from support.patience import PATIENCE
from support.programs.server_processes import is_server
from volsplat.bench.commands.command import SUMMARIES
from volsplat.client.command.cli import main
from volsplat.client.command.commands import ENTRIES

VOLSPLAT = Path(sys.executable).parent / "volsplat"
SERVERS = ("mapshade_server", "splat_server")

# Loads once what each command would load again, for a second or two: commands are forked from it, and what prepares.
LOADED = get_context("forkserver")
_COMMANDS = [entry.module.format(name=name) for name, entry in ENTRIES.items() if not entry.program]
_BENCHMARKS = [f"volsplat.bench.commands.{name}_command" for name in SUMMARIES]
_PAGES = [f"volsplat.client.ui.{name}" for name in ("application", "opening.start_page", "page")]
_LIBRARIES = ["torch", "SimpleITK", "OpenImageIO", "distributed"]
_PREPARING = ["volsplat.mapshade_server.prepare"]
LOADED.set_forkserver_preload([*_COMMANDS, *_BENCHMARKS, *_LIBRARIES, *_PAGES, *_PREPARING])


class Forked:
    """A command that runs in a process whose modules were loaded before it was forked. To be used as a Popen."""

    def __init__(self, words: list[str], folder: Path, environment: dict[str, str]) -> None:
        reader, writer = LOADED.Pipe(duplex=False)
        with reader, writer:
            self._process = LOADED.Process(target=_piped_command, args=(words, folder, environment, writer))
            self._process.start()
            self.stderr = open(os.dup(reader.fileno()), encoding="utf-8")
        assert self._process.pid is not None
        self.pid = self._process.pid

    def send_signal(self, number: int) -> None:
        if self._process.is_alive():
            os.kill(self.pid, number)

    def wait(self, timeout: float | None = None) -> int:
        """Its status. Raises subprocess.TimeoutExpired."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0)
        return self._process.exitcode

    def close(self) -> None:
        """End it, however it is."""
        self._process.kill()
        self._process.join()
        self.stderr.close()


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
        with TemporaryDirectory() as place:
            said = [Path(place, name) for name in ("stdout", "stderr")]
            words = ["volsplat", *arguments]
            process = LOADED.Process(target=_command, args=(words, self.folder, self.environment, said))
            process.start()
            process.join(PATIENCE)
            if process.exitcode is None:
                process.kill()
            process.join()
            out, err = (path.read_text(encoding="utf-8") for path in said)
            assert process.exitcode is not None and process.exitcode != -9, f"{words} never ended: {out}{err}"
            return subprocess.CompletedProcess(words, process.exitcode, out, err)

    def begins(self, *arguments: str) -> Forked:
        """The command, as `runs` runs it, whose stderr can be read meanwhile."""
        return Forked(["volsplat", *arguments], self.folder, self.environment)

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
                    if process.environ().get("VOLSPLAT_TOKEN") == self.token and process.is_running():
                        found.append(process)
            except psutil.NoSuchProcess:
                continue
        return found


def is_under_way(command: "subprocess.Popen[str]") -> bool:
    """Whether what `Person.starts` has started has begun: before, Python itself would answer to a signal."""
    return command.poll() is not None or "msgspec" in Path(f"/proc/{command.pid}/maps").read_text(encoding="utf-8")


def _command(words: list[str], folder: Path, environment: dict[str, str], said: list[Path]) -> NoReturn:
    for number, path in enumerate(said, start=1):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), number)
    _become(words, folder, environment)


def _piped_command(words: list[str], folder: Path, environment: dict[str, str], stderr: Connection) -> NoReturn:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(stderr.fileno(), 2)
    stderr.close()
    _become(words, folder, environment)


def _become(words: list[str], folder: Path, environment: dict[str, str]) -> NoReturn:
    from volsplat.client.ui import application  # loaded already

    application.RECONNECT_SECONDS = PATIENCE  # a page that a busy machine keeps waiting is not loaded anew
    os.chdir(folder)
    os.environ.update(environment)  # what libraries have set while they were loaded stays
    sys.argv = words
    main()
