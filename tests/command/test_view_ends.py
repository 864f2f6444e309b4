"""`volsplat view` is told to end: by signals at any moment, by the end of whoever reads its output, over ssh."""

from __future__ import annotations

import getpass
import os
import secrets
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest
from websockets.exceptions import ConnectionClosed

from support.pages.viewed import viewed, viewed_from_shell
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import VOLSPLAT, Person
from support.programs.server_processes import is_server
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
HIDES_CURSOR, SHOWS_CURSOR = b"\x1b[?25l", b"\x1b[?25h"  # before and after what moves
SAID = {signal.SIGINT: ["volsplat: interrupted"], signal.SIGTERM: [], signal.SIGHUP: []}


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volume") / "head.nrrd"
    write_volume(path, *make_phantom("head", (24, 32, 28)))
    return path


class Begun:
    """A view whose stderr is a file, which servers that hold it open do not keep from being read."""

    def __init__(self, volume: Path, folder: Path, *options: str) -> None:
        self.person = Person(folder)
        self._said = folder / "said.txt"
        with self._said.open("w") as stderr:
            command = [str(VOLSPLAT), "view", str(volume), "--no-browser", "--workers", "2", *options]
            self.process = subprocess.Popen(command, env=self.person.environment, stderr=stderr, cwd=folder)

    def said(self) -> str:
        return self._said.read_text(encoding="utf-8")

    def ends_by(self, number: signal.Signals) -> None:
        """With its status, hardly a word, and nothing left."""
        self.process.send_signal(number)
        assert self.process.wait(PATIENCE) == STATUS[number], self.said()
        wait_until(lambda: not self.person.servers(), "without servers")
        words = [line for line in self.said().splitlines() if line.startswith("volsplat: ")]
        assert words == SAID[number] and "Traceback" not in self.said() and "ASGI" not in self.said()


@pytest.mark.parametrize("number", STATUS, ids=str)
def test_a_signal_ends_it_before_there_is_a_page(volume: Path, tmp_path: Path, number: signal.Signals) -> None:
    begun = Begun(volume, tmp_path)
    wait_until(lambda: begun.person.servers(), "with a server")
    begun.ends_by(number)


def test_a_signal_ends_it_while_it_waits_for_servers(volume: Path, tmp_path: Path) -> None:
    begun = Begun(volume, tmp_path, "--listen", "127.0.0.1:0", "--token-file", str(tmp_path / "token"))
    wait_until(lambda: "waiting for servers" in begun.said(), "waiting")
    begun.ends_by(signal.SIGTERM)


def test_once_the_page_is_served_nothing_moves_on_the_terminal(volume: Path, tmp_path: Path) -> None:
    ours, terminal = os.openpty()
    command = [str(VOLSPLAT), "view", str(volume), "--no-browser", "--workers", "1"]
    environment = Person(tmp_path).environment | {"TERM": "xterm"}
    with subprocess.Popen(command, env=environment, stderr=terminal, cwd=tmp_path) as process:
        os.close(terminal)
        said = b""
        while b"?token=" not in said:
            said += os.read(ours, 1 << 16)
        shown, _, _ = said.partition(b"head.nrrd is at")
        assert shown.rfind(HIDES_CURSOR) >= 0 and shown.rfind(SHOWS_CURSOR) > shown.rfind(HIDES_CURSOR)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == STATUS[signal.SIGINT]
    os.close(ours)


@pytest.mark.parametrize("number", STATUS, ids=str)
def test_a_signal_ends_it_while_a_page_looks_on(volume: Path, number: signal.Signals) -> None:
    with viewed_from_shell(volume.parent, volume, "--workers", "1") as view, view.viewport("a") as viewport:
        viewport.says("size", width=64, height=64)
        viewport.last_picture()
        view.process.send_signal(number)
        assert view.process.wait(PATIENCE) == STATUS[number]
    words = [line.strip() for line in view.said if line.strip() and "http" not in line and "is at" not in line]
    assert words == SAID[number]


@pytest.mark.parametrize("server", ["mapshade_server", "splat_server"])
def test_a_signal_ends_it_and_a_server_that_is_stopped(volume: Path, tmp_path: Path, server: str) -> None:
    begun = Begun(volume, tmp_path)
    wait_until(lambda: "token=" in begun.said(), "there")
    next(running for running in begun.person.servers() if is_server(running, server)).suspend()
    begun.ends_by(signal.SIGTERM)


def test_a_page_that_vanishes_is_no_word_worth(volume: Path) -> None:
    with viewed(volume.parent, volume, "--workers", "1") as view:
        for tab in "abcdef":
            with view.viewport(tab) as viewport:
                viewport.says("size", width=64, height=64)
                viewport.message("scene")
                socket_of(viewport).shutdown(socket.SHUT_RDWR)  # as if a laptop is closed
        with view.viewport("bytes") as viewport:
            viewport._socket.send(b"\0")
            with pytest.raises(ConnectionClosed, match="1003"):
                while True:
                    viewport.hears()
        with view.viewport("g") as viewport:
            viewport.says("size", width=64, height=64)
            viewport.last_picture()
    assert not any("ASGI" in line or "Traceback" in line or "rror" in line for line in view.said), view.said


def socket_of(viewport: object) -> socket.socket:
    found = viewport._socket.socket  # type: ignore[attr-defined]
    assert isinstance(found, socket.socket)
    return found


# -- whoever reads the output has gone


def test_it_ends_with_whoever_reads_what_it_says(volume: Path, tmp_path: Path) -> None:
    person = Person(tmp_path)
    view = person.starts("view", str(volume), "--no-browser", "--workers", "1")
    assert view.stderr is not None and view.stdout is not None
    for line in view.stderr:
        if "token=" in line:
            break
    view.stderr.close()
    assert view.wait(PATIENCE) == STATUS[signal.SIGHUP]
    view.stdout.close()
    wait_until(lambda: not person.servers(), "without servers")


def test_a_port_that_is_taken_is_told_with_what_holds_it(volume: Path, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as held:
        port = held.getsockname()[1]
        done = Person(tmp_path).runs("view", str(volume), "--no-browser", "--port", str(port))
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"--port {port}" in done.stderr
    if Path("/proc/net/tcp").exists():
        assert f"process {os.getpid()} (" in done.stderr and f"kill {os.getpid()}" in done.stderr


# -- over ssh

SSHD = shutil.which("sshd", path=os.environ["PATH"] + ":/usr/sbin")


@contextmanager
def ssh_door(folder: Path) -> Iterator[list[str]]:
    """An sshd of one's own on loopback; the words of a client that reaches it."""
    if SSHD is None or shutil.which("ssh") is None:
        pytest.skip("this test needs ssh and sshd: apt install openssh-server")
    for name in ("host", "key"):
        key = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(key, check=True)
    shutil.copy(folder / "key.pub", folder / "authorized")
    if os.getuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)
    port = str(free_port())
    settings = {"StrictModes": "no", "UsePAM": "no", "PidFile": "none", "PasswordAuthentication": "no"}
    settings |= {"AuthorizedKeysFile": str(folder / "authorized"), "HostKey": str(folder / "host")}
    given = [word for name, value in settings.items() for word in ("-o", f"{name}={value}")]
    command = [SSHD, "-D", "-e", "-f", "/dev/null", "-p", port, "-o", "ListenAddress=127.0.0.1", *given]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as door:
        try:
            wait_until(lambda: can_connect(int(port)), "an sshd")
            trust = ["-o", "StrictHostKeyChecking=no", "-o", "UserKnownHostsFile=/dev/null", "-o", "BatchMode=yes"]
            yield ["ssh", "-F", "/dev/null", "-i", str(folder / "key"), "-p", port, *trust, "-o", "LogLevel=ERROR"]
        finally:
            door.terminate()


def can_connect(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.parametrize("terminal", ["-T", "-tt"])
def test_the_end_of_ssh_ends_the_view_and_frees_its_port(volume: Path, tmp_path: Path, terminal: str) -> None:
    mark = f"head-{secrets.token_hex(4)}.nrrd"
    shutil.copy(volume, tmp_path / mark)
    with ssh_door(tmp_path) as ssh:
        port = str(free_port())
        remote = f"{VOLSPLAT} view {tmp_path / mark} --no-browser --workers 1 --port {port}"
        for _ in range(2):  # the second needs the first one's port
            command = [*ssh, terminal, f"{getpass.getuser()}@127.0.0.1", remote]
            with subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
            ) as run:
                assert run.stdout is not None
                said = b""
                while b"token=" not in said:
                    line = run.stdout.readline()
                    assert line, said.decode()
                    said += line
                run.kill()
            wait_until(lambda: not views_of(mark), "ended")


def views_of(mark: str) -> list[psutil.Process]:
    """The programs that show a volume of this name, but for what carries their command lines."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        words = process.info["cmdline"] or []
        if len(words) > 1 and words[1].endswith("volsplat") and any(word.endswith(mark) for word in words):
            found.append(process)
    return found
