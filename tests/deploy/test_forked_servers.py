"""Servers that are forked from one process: how they are told of, and what becomes of them if that process is gone."""

import errno
import os
import queue
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
from volsplat.client.session.links.server_links import ServerLinks
from volsplat.deploy import forked_servers as forking
from volsplat.deploy import local
from volsplat.deploy.fork_server import Start
from volsplat.deploy.forked_servers import COMMAND, FORK_SERVER, ForkedServer, ForkedServers, forked_servers
from volsplat.deploy.local import LocalServers
from volsplat.deploy.process_end import NO_MEMORY, NO_PROCESS, WITH_ITS_STARTER, told_end
from volsplat.deploy.server_command import Program
from volsplat.protocol.wire.tokens import new_token

__all__ = ["head"]


def _waiting(forks: ForkedServers) -> ForkedServer:
    return forks.start(Program.MAPSHADE_SERVER, ["--wait-at", "127.0.0.1:0"], {"VOLSPLAT_TOKEN": "a" * 64})


def test_a_server_has_its_own_arguments_environment_and_end() -> None:
    forks = ForkedServers()
    try:
        refused = forks.start(Program.SPLAT_SERVER, ["--no-such-option"], {})
        assert refused.wait(PATIENCE) == 2 and refused.pid
        running = _waiting(forks)
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


REFUSES = """
import os
def refused(): raise OSError({number}, os.strerror({number}))
os.fork = refused
from volsplat.deploy.fork_server import main
main()
"""


@pytest.mark.parametrize(("number", "status"), [(errno.EAGAIN, NO_PROCESS), (errno.ENOMEM, NO_MEMORY)])
def test_a_server_that_the_system_refuses_has_ended_with_the_cause(
    number: int, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forking, "COMMAND", (sys.executable, "-c", REFUSES.format(number=number)))
    forks = ForkedServers()
    try:
        refused = [forks.start(Program.SPLAT_SERVER, [], {}) for _ in range(2)]
        assert [server.wait(PATIENCE) for server in refused] == [status] * 2
        assert not forks._servers and not any(server.pid for server in refused)
    finally:
        forks.end()
    assert ("can't start new thread" in told_end(status)) == (number == errno.EAGAIN)


def test_one_that_the_system_refuses_is_told_once_and_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forking, "COMMAND", (sys.executable, "-c", REFUSES.format(number=errno.ENOMEM)))
    monkeypatch.setattr(local, "forked_servers", forked_servers)  # one of its own
    told = queue.SimpleQueue[tuple[str, bool]]()
    servers = LocalServers(lambda line, name, again: told.put((line, again)))
    try:
        servers.start(Program.SPLAT_SERVER, "127.0.0.1:1", new_token(), threads=1)
        line, again = told.get(timeout=PATIENCE)
        assert (
            line.startswith("the splat server could not be started: this machine has not enough memory") and not again
        )
        assert len(servers._processes) == 1
    finally:
        servers.stop()


def test_servers_share_the_session_of_who_starts_them_but_not_its_process_group() -> None:
    forks = ForkedServers()
    try:
        running = _waiting(forks)
        wait_until(lambda: os.getpgid(running.pid) == running.pid, "is it out of reach of Ctrl-C")
        assert os.getsid(running.pid) == os.getsid(0)
    finally:
        forks.end()


SPEAKS_IN_THE_BACKGROUND = """
import fcntl, sys, termios
from volsplat.deploy.forked_servers import ForkedServers
from volsplat.deploy.server_command import Program
fcntl.ioctl(2, termios.TIOCSCTTY, 0)
settings = termios.tcgetattr(2)
settings[3] |= termios.TOSTOP
termios.tcsetattr(2, termios.TCSANOW, settings)
print(ForkedServers().start(Program.SPLAT_SERVER, ["--no-such-option"], {}).wait())
"""


def test_a_server_may_speak_on_a_terminal_that_stops_what_does_so_in_the_background() -> None:
    ours, its = os.openpty()
    with os.fdopen(ours, "rb"), os.fdopen(its, "wb") as terminal:
        ended = subprocess.run(
            [sys.executable, "-c", SPEAKS_IN_THE_BACKGROUND],
            stdout=subprocess.PIPE,
            stderr=terminal,
            text=True,
            timeout=PATIENCE,
            start_new_session=True,
        )
    assert ended.stdout.split() == ["2"]


ENDS_BETWEEN = r"""
import sys
from volsplat.deploy import forked_servers
tells = 'import os; os.write(0, b"{\\"type\\":\\"Started\\",\\"process\\":0}\\n")'
forked_servers.COMMAND = (sys.executable, "-c", tells)
forks = forked_servers.ForkedServers()
print(forks.start(forked_servers.Program.SPLAT_SERVER, [], {}).wait(), flush=True)
"""


def test_no_number_that_is_told_ends_the_processes_of_who_asked() -> None:
    """0 is its own process group, to the system."""
    done = subprocess.run(
        [sys.executable, "-c", ENDS_BETWEEN], capture_output=True, text=True, timeout=PATIENCE, start_new_session=True
    )
    assert (done.returncode, done.stdout) == (0, f"{WITH_ITS_STARTER}\n"), done.stderr


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
