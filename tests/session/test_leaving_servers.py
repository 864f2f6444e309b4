"""Servers that are ended by SIGTERM: others take over between two frames, so that none is incomplete."""

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from threading import Thread

import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.resident_servers import MAPSHADE, SPLAT, opened
from support.programs.server_processes import frozen, servers
from volsplat.client import Session
from volsplat.client.session.renderer import Refinement
from volsplat.client.session.single import SingleProcess
from volsplat.program.departure import LEAVE_SECONDS, LEAVING_SILENCE
from volsplat.program.exit_status import EXIT_TERMINATED
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import (
    DescribeMachine,
    EndSession,
    LeaveSession,
    MachineDescribed,
    NameSession,
)
from volsplat.protocol.messages.trace_messages import ReadClock
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.framing import MAGIC
from volsplat.protocol.wire.heartbeat import Heartbeat
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

__all__ = ["head", "scene", "single"]

ROLES = {MAPSHADE: "map/shade server", SPLAT: "splat server"}

SOON = 0.6 * LEAVE_SECONDS  # ten times what a silent client is given, and too short to wait for one that is heard
UNTIL = f"told to end; while the client is heard, it has up to {LEAVE_SECONDS:g} s to have others take over"
BUSY = """
import logging, os, signal, socket, threading
from contextlib import suppress
from volsplat.program.departure import Departure
from volsplat.protocol.text.errors import PeerLost, RemoteProtocolError
from volsplat.protocol.wire.connection import Connection

ours, theirs = socket.socketpair()
client = Connection(ours, "the client")
departure = Departure()
departure.watch()
departure.attend(client)
says_so = threading.Event()
logging.getLogger("volsplat.program.departure").addFilter(lambda line: says_so.set() or True)

def receive():
    with suppress(PeerLost, RemoteProtocolError):
        client.receive()

def breaks_the_protocol():
    theirs.sendall(bytes(16))
    receive()
    assert client.closed

def tell_to_end():
    os.kill(os.getpid(), signal.SIGTERM)

{}
threading.Event().wait()  # it is at work, and has not seen yet what became of its client
"""
SILENT = f"the client has said nothing for {LEAVING_SILENCE:g} s: it is frozen, overloaded or cut off; "
WITHOUT = "this server ends without it"
BROKEN = f"the client broke the protocol: magic is 0x00000000, but volsplat's is 0x{MAGIC:08x}; {WITHOUT}"


@pytest.mark.parametrize(
    ("happens", "said", "status"),
    [
        ("theirs.close(); tell_to_end()", [], EXIT_TERMINATED),
        ("theirs.close(); receive(); assert client.closed; tell_to_end()", [], EXIT_TERMINATED),
        ("breaks_the_protocol(); tell_to_end()", [BROKEN], EXIT_TERMINATED),
        ("tell_to_end()", [UNTIL, SILENT + WITHOUT], EXIT_TERMINATED),
        (
            "tell_to_end(); says_so.wait(); client.give_up('it is lost')",
            [UNTIL, f"it is lost; {WITHOUT}"],
            EXIT_TERMINATED,
        ),
        ("tell_to_end(); says_so.wait(); theirs.close()", [UNTIL, SILENT + WITHOUT], EXIT_TERMINATED),
        ("tell_to_end(); says_so.wait(); breaks_the_protocol()", [UNTIL, BROKEN], EXIT_TERMINATED),
        ("tell_to_end(); says_so.wait(); client.close()", [UNTIL], 0),
    ],
    ids=[
        "gone",
        "lost",
        "broke the protocol",
        "silent",
        "lost meanwhile",
        "gone meanwhile",
        "breaks the protocol",
        "ends the session",
    ],
)
def test_a_server_at_work_whose_client_hears_it_no_more_ends_and_says_no_more_than_why(
    happens: str, said: list[str], status: int
) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", BUSY.format(happens)], capture_output=True, text=True, timeout=PATIENCE
    )
    assert (ended.returncode, ended.stderr.splitlines()) == (status, said)


def test_a_resident_that_cannot_use_any_client_ends_as_one_that_finds_none() -> None:
    command = [sys.executable, "-m", f"volsplat.{SPLAT}", "--connect", "nobody.invalid:7000", "--resident"]
    ended = subprocess.run(
        [*command, "--keep", "1"],
        env={"VOLSPLAT_TOKEN": new_token().key.decode()},
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert ended.returncode != 0 and ended.stderr.count("looking for a client again") == 1


def refined(session: Session, scene: Scene) -> list[Refinement]:
    return [refinement for refinement in session.refine(scene) if refinement.complete]


def check_whole(refinements: list[Refinement], single: SingleProcess, scene: Scene) -> None:
    for refinement in refinements:
        assert refinement.outcome is not None and refinement.outcome.servers.missing == ()
        assert torch.equal(refinement.image, single.render(scene, refinement.step))


def ends_by_sigterm(process: "subprocess.Popen[bytes]") -> None:
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE) == 0


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_while_frames_are_drawn_the_others_take_over_and_none_is_incomplete(
    head: Path, single: SingleProcess, scene: Scene, program: str
) -> None:
    with opened(head, workers=2, splat_servers=2) as servers:
        check_whole(refined(servers.session, scene), single, scene)
        leaving = Thread(target=ends_by_sigterm, args=(servers.of[program][0],))
        leaving.start()
        while leaving.is_alive():
            check_whole(refined(servers.session, scene), single, scene)
        leaving.join()
        assert servers.of[program][0].returncode == 0
        check_whole(refined(servers.session, scene), single, scene)
        (lost,) = [server for server in servers.session.servers if server.lost]
        assert lost.cause.startswith(ROLES[program]) and lost.cause.endswith("left: it was told to end")


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_that_joins_takes_the_place_of_the_only_one(
    head: Path, single: SingleProcess, scene: Scene, program: str
) -> None:
    with opened(head, workers=1, splat_servers=1) as servers:
        check_whole(refined(servers.session, scene), single, scene)
        servers.join(program)
        ends_by_sigterm(servers.of[program][0])
        check_whole(refined(servers.session, scene), single, scene)


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_in_the_place_of_the_only_one_the_client_starts_another(
    head: Path, single: SingleProcess, scene: Scene, program: str
) -> None:
    with Session(head, workers=1) as session:
        check_whole(refined(session, scene), single, scene)
        for server in servers(session, program):
            server.terminate()
        wait_until(lambda: any(server.lost for server in session.servers), "gone")
        check_whole(refined(session, scene), single, scene)


# Draws with servers that it starts, whom it reaches in each way that there is; says which they are, and draws again.
CLIENT = """
import sys
from contextlib import ExitStack
from volsplat.client import Session
from volsplat.client.scene.default_scene import default_scene

DOOR, PORT = "127.0.0.1:0", "127.0.0.2:0"  # no Unix socket leads to the second
with ExitStack() as stack:
    sessions = [
        stack.enter_context(Session(sys.argv[1], workers=1, splat_servers=1, listen=listen, tls=tls))
        for listen, tls in ((DOOR, None), (PORT, None), (PORT, True))
    ]
    scene = default_scene(sessions[0].volume.subject())
    for session in sessions:
        session.render(scene)
    print(*(pid for session in sessions for pid in session.server_processes), flush=True)
    sys.stdin.readline()
    print(*(refined.complete for session in sessions for refined in list(session.refine(scene))[-1:]), flush=True)
"""


def test_servers_of_a_client_that_is_stopped_end_soon_and_others_draw_once_it_goes_on(head: Path) -> None:
    command = [sys.executable, "-c", CLIENT, str(head)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as client:
        assert client.stdin is not None and client.stdout is not None
        servers = [os.pidfd_open(int(pid)) for pid in client.stdout.readline().split()]
        assert len(servers) == 6
        with frozen(psutil.Process(client.pid)):
            until = time.monotonic() + SOON
            for server in servers:
                signal.pidfd_send_signal(server, signal.SIGTERM)
            for server in servers:
                assert select.select([server], [], [], max(0.0, until - time.monotonic()))[0], "it has not ended"
                os.close(server)
        print("go on", file=client.stdin, flush=True)
        assert client.stdout.readline() == "True True True\n"
        assert client.wait(PATIENCE) == 0


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_without_a_client_it_ends_at_once(program: str, tmp_path: Path) -> None:
    address = f"127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", f"volsplat.{program}", "--wait-at", address, "--resident"]
    environment = {"VOLSPLAT_TOKEN": new_token().key.decode()}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None and b"waiting for clients" in process.stderr.readline()
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0


def said_by(server: Connection) -> Message:
    received = server.receive()
    assert received is not None
    return received.message


@contextmanager
def client_of(
    program: str, begin: str = "", stderr: int | None = None
) -> Iterator[tuple["subprocess.Popen[bytes]", Connection]]:
    """A server that has heard its client. The server's process runs `begin` first."""
    token = new_token()
    with Listener(Role.CLIENT, token) as listener:
        run = f"from volsplat.program.server_process import run_server; run_server('volsplat.{program}.command', "
        run = f"{begin}\n{run}'{program}', '{program}')"
        arguments = ["--connect", str(listener.address)]
        environment = {"VOLSPLAT_TOKEN": token.key.decode()}
        with subprocess.Popen([sys.executable, "-c", run, *arguments], env=environment, stderr=stderr) as process:
            client = listener.accept()
            assert client is not None
            with client:
                client.send(DescribeMachine())
                assert isinstance(said_by(client), MachineDescribed)
                try:
                    yield process, client
                finally:
                    process.kill()  # if it has not ended


@contextmanager
def client_that_keeps(program: str, begin: str = "") -> Iterator[tuple["subprocess.Popen[bytes]", Connection]]:
    """Likewise after its first SIGTERM, which its client has heard of."""
    with client_of(program, begin) as (process, client):
        process.send_signal(signal.SIGTERM)
        assert said_by(client) == LeaveSession()
        yield process, client


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_whose_client_breaks_the_protocol_before_it_lets_go_says_so(
    program: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with client_that_keeps(program) as (process, client):
        client._socket.sendall(bytes(16))
        assert process.wait(PATIENCE) == EXIT_TERMINATED
    said = capfd.readouterr().err.splitlines()[-1]
    assert "broke the protocol: magic is 0x00000000" in said and said.endswith(WITHOUT)


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_whose_client_has_broken_the_protocol_says_so_before_it_is_told_to_end(program: str) -> None:
    with client_of(program, stderr=subprocess.PIPE) as (process, client):
        assert process.stderr is not None
        client._socket.sendall(bytes(16))
        said = process.stderr.readline()
        assert b"broke the protocol: magic is 0x00000000" in said and said.endswith(b"; looking for a client again\n")
        process.send_signal(signal.SIGTERM)
        assert (process.wait(PATIENCE), process.stderr.read()) == (0, b"")


# It is told to end as soon as it has said why it does without its client.
TOLD_AFTER_ITS_LINE = """
import logging, os, signal, threading, time

say = logging.Logger.callHandlers

def say_and_tell_to_end(logger, line):
    say(logger, line)
    if threading.current_thread() is threading.main_thread() and "broke the protocol" in line.getMessage():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.2)  # time enough for whoever follows SIGTERM to say it again

logging.Logger.callHandlers = say_and_tell_to_end
"""


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_whose_client_breaks_the_protocol_says_so_once_however_soon_sigterm_comes(program: str) -> None:
    with client_of(program, TOLD_AFTER_ITS_LINE, stderr=subprocess.PIPE) as (process, client):
        client._socket.sendall(bytes(16))
        assert process.wait(PATIENCE) == 0 and process.stderr is not None
        assert process.stderr.read().count(b"broke the protocol") == 1


# Its main thread is at work for ever once the session has a name; its receiving thread fails when asked for the clock.
FAILS = """
import sys, threading
from volsplat.{0} import server
from volsplat.protocol.messages.trace_messages import ReadClock
from volsplat.protocol.wire.connection import Connection

receive = Connection.receive

def fails(client):
    received = receive(client)
    if isinstance(received.message, ReadClock):
        raise TypeError("a mistake of ours")
    return received

Connection.receive = fails
server.name_session = lambda _: print("at work", file=sys.stderr, flush=True) or threading.Event().wait()
"""
MISTAKE = b"TypeError: a mistake of ours"


@contextmanager
def client_of_one_that_fails(program: str) -> Iterator[tuple["subprocess.Popen[bytes]", Connection]]:
    """At work, until it is asked for the clock. Its client is there all the time."""
    begin = FAILS.format(program)
    with client_of(program, begin, subprocess.PIPE) as (process, client), closing(Heartbeat()) as heartbeat:
        heartbeat.keep(client, None)
        client.send(NameSession("a"))
        read_until(process, b"at work")
        yield process, client


def read_until(process: "subprocess.Popen[bytes]", said: bytes) -> None:
    assert process.stderr is not None
    while said not in (line := process.stderr.readline()):
        assert line, "it has ended"


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_that_fails_by_itself_does_not_end_as_one_that_was_let_go(program: str) -> None:
    with client_of_one_that_fails(program) as (process, client):
        client.send(ReadClock())
        read_until(process, MISTAKE)
        process.send_signal(signal.SIGTERM)
        assert process.wait(SOON) == EXIT_TERMINATED


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_nor_does_one_that_fails_while_its_client_has_others_take_over(program: str) -> None:
    with client_of_one_that_fails(program) as (process, client):
        process.send_signal(signal.SIGTERM)
        assert said_by(client) == LeaveSession()
        client.send(ReadClock())
        read_until(process, b"the client is not heard any more: " + MISTAKE + f"; {WITHOUT}".encode())
        assert process.wait(SOON) == EXIT_TERMINATED


def test_it_looks_for_no_other_client_however_soon_after_sigterm_its_own_is_lost() -> None:
    """Though the thread that follows SIGTERM may not have come to it yet."""
    happens = "departure._lock.acquire(); tell_to_end(); departure._client = None; os._exit(not departure.begun)"
    assert subprocess.run([sys.executable, "-c", BUSY.format(happens)], timeout=PATIENCE).returncode == 0


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_a_second_sigterm_ends_it_at_once(program: str) -> None:
    with client_that_keeps(program) as (process, _):
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == EXIT_TERMINATED


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_it_waits_for_a_client_that_gives_signs_of_life_though_it_says_nothing_else(program: str) -> None:
    """As while a long frame is drawn."""
    begin = "import volsplat.program.departure as departure; departure.LEAVE_SECONDS = 2 * departure.LEAVING_SILENCE"
    with client_that_keeps(program, begin) as (process, client), closing(Heartbeat()) as heartbeat:
        heartbeat.keep(client, None)
        assert process.wait(PATIENCE) == 0


def test_it_waits_no_longer_than_it_can() -> None:
    begin = "import volsplat.program.departure as departure; departure.LEAVE_SECONDS = 0.2"
    with client_that_keeps(MAPSHADE, begin) as (process, _):
        assert process.wait(PATIENCE) == 0


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_that_its_client_lets_go_ends_though_it_is_resident(program: str) -> None:
    begin = "import sys; sys.argv.append('--resident')"
    with client_that_keeps(program, begin) as (process, client):
        client.send(EndSession())
        assert process.wait(PATIENCE) == 0
