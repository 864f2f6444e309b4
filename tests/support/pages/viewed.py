"""A volume viewed by the real command `volsplat view`, and a viewport that is not a browser's.

tests/ui/conftest.py has the fixtures `volume` and `view` for most tests of the page. A test module elsewhere, or for
another volume, imports those from here by name, and names them in its `__all__`; `phantom`, which it imports as well or
makes its own, says what is viewed.
"""

from __future__ import annotations

import base64
import json
import re
import signal
import threading
import zlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from subprocess import Popen
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from websockets.sync.client import ClientConnection, connect

from support.pages import patient_http
from support.patience import PATIENCE
from support.programs.forked_programs import Begun
from support.programs.programs import Person
from support.programs.server_processes import is_server
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.protocol.description.volume import Index

HEAD: tuple[str, Index] = ("head", (24, 32, 28))
# A scene as links have it: what differs from the first one, which is nothing.
FIRST = base64.urlsafe_b64encode(zlib.compress(b"{}")).decode().rstrip("=")
UNUSED_SECONDS = 86400  # between two modules that view it
_JOIN = re.compile(r"volsplat (splat-server|mapshade-server) (--connect \S+)")
_ADDRESS = re.compile(r"http://\S+token=\S+")


@dataclass
class Viewed:
    """A running `volsplat view`."""

    url: str
    process: Begun | Popen[str]
    person: Person
    said: list[str] = field(default_factory=list)  # lines on its stderr

    @property
    def port(self) -> int:
        port = urlsplit(self.url).port
        assert port is not None
        return port

    @property
    def cookie(self) -> str:
        """What a browser gets for the token."""
        return patient_http.get(self.url).headers["set-cookie"].partition(";")[0]

    def mapshade_servers(self) -> list[psutil.Process]:
        return [server for server in self.person.servers() if is_server(server, "mapshade_server")]

    def asks_to_start(self) -> dict[str, list[str]]:
        """The programs that a person is to start by hand, each with its options."""
        asked = [found.groups() for line in self.said if (found := _JOIN.search(line))]
        return {program: options.split() for program, options in asked}

    @contextmanager
    def viewport(self, tab: str, port: int | None = None, **headers: str) -> Iterator[Viewport]:
        address = f"ws://127.0.0.1:{port or self.port}/viewport?tab={tab}"
        cookie = self.cookie.replace(f"volsplat-{self.port}=", f"volsplat-{port or self.port}=")
        with connect(
            address, additional_headers={"Cookie": cookie, **headers}, max_size=None, open_timeout=PATIENCE
        ) as socket:
            yield Viewport(socket)


@contextmanager
def viewed(folder: Path, volume: Path | None, *arguments: str) -> Iterator[Viewed]:
    """Fork the command in a folder, wait for its address, and end it by Ctrl-C; nothing may be left then."""
    person = Person(folder)
    with closing(person.begins(*_words(volume, arguments))) as process, watched(process, person) as view:
        yield view
    assert not person.servers(), "servers were left behind"


@contextmanager
def viewed_from_shell(folder: Path, volume: Path, *arguments: str) -> Iterator[Viewed]:
    """The same, with the command as a shell starts it."""
    person = Person(folder)
    with person.starts(*_words(volume, arguments)) as process:
        try:
            with watched(process, person) as view:
                yield view
        finally:
            process.kill()
    assert not person.servers(), "servers were left behind"


def _words(volume: Path | None, arguments: Iterable[str]) -> list[str]:
    return ["view", *([] if volume is None else [str(volume)]), "--no-browser", *arguments]


@contextmanager
def watched(process: Begun | Popen[str], person: Person) -> Iterator[Viewed]:
    """Wait for the command's address, and end it by Ctrl-C."""
    assert process.stderr is not None
    said: list[str] = []
    watchdog = threading.Timer(PATIENCE, process.send_signal, [signal.SIGKILL])
    watchdog.start()
    try:
        url = _address(process.stderr, said)
    finally:
        watchdog.cancel()
    assert url is not None, "".join(said)
    reading = threading.Thread(target=said.extend, args=[process.stderr], daemon=True)
    reading.start()
    try:
        yield Viewed(url, process, person, said)
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)
    finally:
        process.send_signal(signal.SIGKILL)
        reading.join(PATIENCE)


class KeptView:
    """A volume viewed in a folder, for many tests, also of several modules: each module begins with the first scene.

    What can be undone goes on from module to module. The command is begun anew once a test has failed.
    """

    def __init__(self, folder: Path, volume: Path, *options: str) -> None:
        self._folder, self._volume = folder, volume
        self._options = (*options, "--grace", str(UNUSED_SECONDS))
        self._running = ExitStack()
        self._view: Viewed | None = None
        self._module = ""
        self._failed = 0

    def lent(self, module: str, failed: int) -> Viewed:
        """To a test of this module, before which so many have failed."""
        if self._view is None or failed != self._failed:
            self.close()
            self._view = self._running.enter_context(viewed(self._folder, self._volume, *self._options))
        elif module != self._module:
            link = f"http://127.0.0.1:{self._view.port}/?scene={FIRST}"
            assert patient_http.get(link, headers={"Cookie": self._view.cookie}).is_redirect
        self._module, self._failed = module, failed
        return self._view

    def close(self) -> None:
        self._view = None
        self._running.close()


def written(folder: Path, name: str, size: Index) -> Path:
    path = folder / f"{name}.nrrd"
    write_volume(path, *make_phantom(name, size))
    return path


@pytest.fixture(scope="module")
def phantom() -> tuple[str, Index]:
    """Name and size."""
    return HEAD


@pytest.fixture(scope="module")
def volume(phantom: tuple[str, Index], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("volume"), *phantom)


@pytest.fixture(scope="module")
def view(volume: Path) -> Iterator[Viewed]:
    """By two map/shade servers, for all tests of a module."""
    with viewed(volume.parent, volume, "--workers", "2") as running:
        yield running


def _address(lines: Iterable[str], said: list[str]) -> str | None:
    for line in lines:
        said.append(line)
        if found := _ADDRESS.search(line):
            return found[0]
    return None


@dataclass(frozen=True)
class Shown:
    """One picture as the page gets it."""

    header: dict[str, Any]
    data: bytes


class Viewport:
    """Plays the page's part of a viewport's WebSocket."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.messages: list[dict[str, Any]] = []

    def says(self, kind: str, **fields: Any) -> None:
        self._socket.send(json.dumps({"type": kind, **fields}))

    def says_text(self, text: str) -> None:
        self._socket.send(text)

    def hears(self, timeout: float = PATIENCE) -> Shown | dict[str, Any]:
        """The next picture or message. Raises TimeoutError."""
        heard = self._socket.recv(timeout)
        if isinstance(heard, str):
            message: dict[str, Any] = json.loads(heard)
            self.messages.append(message)
            return message
        length = int.from_bytes(heard[:4], "little")
        return Shown(json.loads(heard[4 : 4 + length]), heard[4 + length :])

    def message(self, kind: str) -> dict[str, Any]:
        """The next message of a kind."""
        while True:
            heard = self.hears()
            if isinstance(heard, dict) and heard["type"] == kind:
                return heard

    def look_until_told(self, words: str) -> None:
        """Look at pictures as they come, until a trouble is told in these words."""
        while True:
            heard = self.hears()
            if isinstance(heard, Shown):
                self.says("shown", number=heard.header["number"])
            elif heard["type"] == "trouble" and words in heard["text"]:
                return

    def pictures(self, *, acknowledging: bool = True) -> Iterator[Shown]:
        """Pictures as they come."""
        while True:
            heard = self.hears()
            if isinstance(heard, Shown):
                if acknowledging:
                    self.says("shown", number=heard.header["number"])
                yield heard

    def last_picture(self, event: int = 0, width: int | None = None) -> list[Shown]:
        """All pictures up to the last one that contains this event, and is so wide."""
        seen = []
        for picture in self.pictures():
            seen.append(picture)
            wanted = picture.header["event"] >= event and width in (None, picture.header["width"])
            if picture.header["last"] and wanted:
                return seen
        raise AssertionError("pictures never end")
