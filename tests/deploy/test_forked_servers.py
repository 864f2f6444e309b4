"""Servers that are forked from one process: how they are told of, and what becomes of them if that process is gone."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import msgspec
import psutil
import pytest

from support.files.head_volume import head
from support.patience import PATIENCE, wait_until
from support.programs.server_processes import is_server, words_of
from volsplat.client import Session
from volsplat.client.session.server_links import ServerLinks
from volsplat.deploy import local
from volsplat.deploy.fork_server import Start
from volsplat.deploy.forked_servers import COMMAND, FORK_SERVER, ForkedServers, forked_servers
from volsplat.deploy.process_end import WITH_ITS_STARTER
from volsplat.deploy.server_command import Program

__all__ = ["head"]


def test_a_server_has_its_own_arguments_environment_and_end() -> None:
    forks = ForkedServers()
    try:
        refused = forks.start(Program.SPLAT_SERVER, ["--no-such-option"], {})
        assert refused.wait(PATIENCE) == 2 and refused.pid
        running = forks.start(Program.MAPSHADE_SERVER, ["--wait-at", "127.0.0.1:0"], {"VOLSPLAT_TOKEN": "a" * 64})
        process = psutil.Process(running.pid)
        wait_until(lambda: is_server(process, "mapshade_server"), "is it shown by its name")
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(0)
        running.kill()
        assert running.wait(PATIENCE) == -signal.SIGKILL
    finally:
        forks.end()


def test_servers_find_the_modules_that_are_loaded_for_all_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    note = "import os\nwith open(__file__ + '.loaded', 'a') as file: print(os.getpid(), file=file)\n"
    (tmp_path / "takes_long.py").write_text(note)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    forks = ForkedServers(["takes_long", "no_such_module"])
    try:
        servers = [forks.start(Program.MAPSHADE_SERVER, ["--no-such-option"], {}) for _ in range(2)]
        assert [server.wait(PATIENCE) for server in servers] == [2, 2]
    finally:
        forks.end()
    (loaded,) = (tmp_path / "takes_long.py.loaded").read_text().split()
    assert int(loaded) not in [server.pid for server in servers]


def test_what_is_asked_of_a_fork_server_that_is_ended_while_it_loads_ends() -> None:
    forks = ForkedServers()
    server = forks.start(Program.SPLAT_SERVER, [], {})
    server.terminate()
    assert server.wait(PATIENCE) == WITH_ITS_STARTER and not server.pid
    wait_until(lambda: forks.gone, "is it noticed")
    with pytest.raises(OSError, match="gone"):
        forks.start(Program.SPLAT_SERVER, [], {})


def test_it_ends_without_a_word_where_nobody_reads_what_it_told() -> None:
    link, its = socket.socketpair()
    with its:
        forks = subprocess.Popen(COMMAND, stdin=its.fileno(), stderr=subprocess.PIPE, encoding="utf-8")
    with link:
        link.sendall(msgspec.json.encode(Start(Program.SPLAT_SERVER, [b"--no-such-option"], {})) + b"\n")
        assert link.recv(1, socket.MSG_PEEK)
    _, said = forks.communicate(timeout=PATIENCE)
    assert forks.returncode == 0
    assert all(line.startswith("splat-server: ") for line in said.splitlines())


def test_none_is_started_in_the_place_of_one_that_ends_with_its_session(
    head: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    close = ServerLinks.close

    def close_late(self: ServerLinks) -> None:
        wait_until(lambda: not self._local.process_ids, "all have ended")
        close(self)

    monkeypatch.setattr(ServerLinks, "close", close_late)
    with Session(head, workers=2) as session:
        assert session.volume
    assert len(session._links._local._processes) == 3


def test_a_session_outlives_its_fork_server(head: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local, "forked_servers", forked_servers)  # one of its own
    told: list[str] = []
    with Session(head, workers=2, on_loss=told.append) as session:
        scene = session.default_scene()
        expected = session.finish(scene).published.pixels
        before = session.server_processes
        fork_server().kill()
        wait_until(lambda: not set(before) & set(session.server_processes), "do its servers end")
        wait_until(lambda: len(session.server_processes) == 3, "are others started")
        assert bytes(session.finish(scene).published.pixels) == bytes(expected)
    assert told and not any("SIGKILL" in line for line in told), told


def test_a_client_that_is_killed_leaves_no_fork_server() -> None:
    begin = "from volsplat.deploy.forked_servers import begin_ahead; begin_ahead(); print(flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", begin], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as client:
        assert client.stdout is not None
        client.stdout.readline()
        (forks,) = psutil.Process(client.pid).children()
        os.kill(client.pid, signal.SIGKILL)
        forks.wait(PATIENCE)


def fork_server() -> psutil.Process:
    """That which this process has started last; all its other tests have one together."""
    return max(
        (one for one in psutil.Process().children() if FORK_SERVER in words_of(one)), key=psutil.Process.create_time
    )
