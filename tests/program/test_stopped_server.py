"""A server that is stopped takes nothing from its socket: nobody waits for it, and nothing is left of it."""

import gzip
import queue
import signal
import subprocess
import sys
import threading
import time
import weakref
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

from support.messages.message_samples import SAMPLES, UNFORESEEN
from support.patience import PATIENCE, wait_until
from support.programs.programs import Person
from volsplat.client.session.links.outgoing import Outgoing
from volsplat.client.session.links.server_links import FAREWELL_SECONDS
from volsplat.deploy.local import GRACE_SECONDS
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import LocalProtocolError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.buffer_pool import BufferPool
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token

# The command itself; before a part of the volume goes to a server that server is stopped, and then the part is sent.
STOPS_WHO_GETS_A_PART = """
import os, re, signal, sys
from volsplat.client.command.cli import main
from volsplat.client.coordinator.events.instructions import Send
from volsplat.client.session.coordination import Coordination
from volsplat.protocol.messages.messages import HoldPart

carry_out = Coordination._carry_out

def stop_and_carry_out(coordination, instruction, links):
    if isinstance(instruction, Send) and isinstance(instruction.message, HoldPart):
        peer = links._links[instruction.server].connection.peer
        os.kill(int(re.search(r"process (\\d+)", peer.name)[1]), signal.SIGSTOP)
        print("stopped", peer.name, flush=True)
    carry_out(coordination, instruction, links)
    if isinstance(instruction, Send) and isinstance(instruction.message, HoldPart):
        print("carried out", flush=True)

Coordination._carry_out = stop_and_carry_out
main()
"""


@pytest.fixture
def zipped(tmp_path: Path) -> Path:
    """A compressed volume whose parts are larger than what a socket holds."""
    values = np.random.default_rng(1).integers(0, 99, 256 * 256 * 160, dtype=np.int16)
    header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 256 256 160\nendian: little\nencoding: gzip\n\n"
    path = tmp_path / "noise.nrrd"
    path.write_bytes(header.encode() + gzip.compress(values.tobytes(), 1))
    return path


@contextmanager
def lending(person: Person, volume: Path) -> Iterator["subprocess.Popen[str]"]:
    """A command that has just begun to send a part to a server that is stopped."""
    command = subprocess.Popen(
        [sys.executable, "-c", STOPS_WHO_GETS_A_PART, "render", str(volume), "-o", "a.png", "--workers", "2"],
        cwd=person.folder,
        env=person.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )
    try:
        assert command.stdout is not None
        assert command.stdout.readline().startswith("stopped")
        yield command
    finally:
        command.kill()
        for server in person.servers():
            server.kill()
        command.communicate()


@pytest.mark.parametrize("interrupts", [1, 3])
def test_ctrl_c_ends_the_command_and_all_servers_while_a_volume_is_lent_to_one_that_is_stopped(
    tmp_path: Path, zipped: Path, interrupts: int
) -> None:
    person = Person(tmp_path)
    with lending(person, zipped) as command:
        assert command.stdout is not None
        assert command.stdout.readline().startswith("carried out"), "the coordinator goes on"
        servers = person.servers()
        wait_until(lambda: [s.status() for s in servers].count(psutil.STATUS_STOPPED) == 1, "stopped")
        began = time.monotonic()
        for _ in range(interrupts):
            command.send_signal(signal.SIGINT)
            time.sleep(0.05)  # the next one comes while the first is at work
        _, said = command.communicate(timeout=PATIENCE)
        print(f"ended after {time.monotonic() - began:.2f} s")
    assert command.returncode == 130, said
    assert psutil.wait_procs(servers, timeout=PATIENCE)[1] == []
    assert said.strip() == "volsplat: interrupted"


def test_all_that_a_stopped_server_is_waited_for_is_less_than_the_two_seconds_that_an_end_may_take() -> None:
    """To read that the session is over, to end by itself, and to end when it is told to; then it is killed."""
    assert FAREWELL_SECONDS + 2 * GRACE_SECONDS <= 1.5


# -- the thread that sends


@pytest.fixture
def ends() -> Iterator[tuple[Connection, Connection]]:
    """A client's connection to a map/shade server, and the server's."""
    token = new_token()
    with Listener(Role.CLIENT, token, allocate=BufferPool()) as listener:
        address = Address(listener.address.host, listener.address.port)
        server = connect(address, new_hello(Role.MAPSHADE_SERVER), token, Role.CLIENT)
        client = listener.accept(PATIENCE)
        assert client is not None
        with client, server:
            yield client, server


def part() -> tuple[messages.HoldPart, memoryview]:
    box = Box((0, 0, 0), (1 << 20, 4, 1))
    held = messages.HoldPart(1, messages.VolumePart(server=2, sub_cube=0, scalar=0, scalar_type="uint8", box=box))
    return held, memoryview(bytes(box.voxels))


def test_whoever_posts_does_not_wait_and_older_frames_that_have_not_left_are_dropped(
    ends: tuple[Connection, Connection],
) -> None:
    client, server = ends
    failures: list[Exception] = []
    outgoing = Outgoing(client, lambda message, error: failures.append(error), failures.append)
    message, payload = part()
    for _ in range(4):
        outgoing.post(message, payload)  # more than any socket holds: nobody reads
    frame = SAMPLES[messages.RenderFrame][0]
    outgoing.post(frame)
    outgoing.post(messages.AbortFrame(7))
    outgoing.post(messages.DescribeMachine())
    outgoing.post(frame)
    outgoing.post(messages.ReadImage(2))  # not for a map/shade server: a mistake that is told, after which all goes on
    outgoing.post(messages.EndSession())
    kinds: list[messages.Message] = []
    while not isinstance(kinds and kinds[-1], messages.EndSession):
        received = server.receive()
        assert received is not None
        kinds.append(received.message)
    names = [type(message).__name__ for message in kinds]
    assert names == ["HoldPart"] * 4 + ["DescribeMachine", "RenderFrame", "EndSession"]
    (failure,) = failures
    assert isinstance(failure, LocalProtocolError)


def test_where_nothing_waits_a_short_message_has_left_when_it_is_posted(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    senders: list[threading.Thread] = []
    failures: list[Exception] = []
    outgoing = Outgoing(
        client,
        lambda message, error: failures.append(error),
        failures.append,
        lambda message, began: senders.append(threading.current_thread()),
    )
    outgoing.post(messages.DescribeMachine(), memoryview(b""))
    assert senders == [threading.current_thread()]
    received = server.receive()
    assert received is not None and received.message == messages.DescribeMachine()
    assert not failures


def test_closing_the_connection_ends_a_send_that_waits(ends: tuple[Connection, Connection]) -> None:
    client, _ = ends
    failures: list[Exception] = []
    outgoing = Outgoing(client, lambda message, error: failures.append(error), failures.append)
    message, payload = part()
    for _ in range(4):
        outgoing.post(message, payload)
    outgoing.flush(time.monotonic() + 0.05)
    client.close()
    outgoing.flush(time.monotonic() + PATIENCE)
    assert outgoing._ended and not failures


def test_what_is_posted_once_nothing_more_is_sent_is_kept_by_nobody(ends: tuple[Connection, Connection]) -> None:
    """As by who has not heard yet that the server is lost."""
    client, _ = ends
    failures: list[Exception] = []
    outgoing = Outgoing(client, lambda message, error: failures.append(error), failures.append)
    client.close()
    outgoing.post(messages.DescribeMachine())
    wait_until(lambda: outgoing._ended, "has it found the connection closed")
    part = array("B", bytes(1 << 20))
    kept = weakref.ref(part)
    outgoing.post(messages.DescribeMachine(), memoryview(part))
    del part
    assert kept() is None and not failures


@pytest.mark.parametrize("payloads", [(), (memoryview(bytes(1 << 20)),)], ids=["at once", "by the sending thread"])
def test_an_error_that_nobody_has_foreseen_is_told_once_and_leaves_nobody_waiting(
    payloads: tuple[memoryview, ...], ends: tuple[Connection, Connection]
) -> None:
    client, _ = ends
    failures: queue.SimpleQueue[Exception] = queue.SimpleQueue()
    outgoing = Outgoing(client, lambda message, error: failures.put(error), failures.put)
    outgoing.post(UNFORESEEN, *payloads)
    assert isinstance(failures.get(timeout=PATIENCE), AttributeError)
    outgoing.post(*part())  # goes nowhere
    outgoing.flush(time.monotonic() + PATIENCE)
    assert outgoing._ended and failures.empty()
