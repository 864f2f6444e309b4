"""An attacker's tour of a live session: whatever comes to its ports, nothing opens or ends, and every frame is right.

The ports are the client's, that of the splat server for data links, and that of a map/shade server which waits.
"""

import random
import resource
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from itertools import count
from pathlib import Path

import numpy as np
import psutil
import pytest
from security.besieged import HOST, Besieged, taken_in
from security.landlock import WITHOUT, has_landlock
from security.recorder import Recorder, played

from support.files.head_volume import head
from support.messages.message_samples import sample_bytes
from support.patience import PATIENCE, wait_until
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import PeerLost, VolsplatError
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import HEADER, LARGEST_CONTROL, LARGEST_GREETING, LARGEST_PAYLOAD, MAGIC
from volsplat.protocol.wire.port import MOST_PENDING
from volsplat.protocol.wire.tokens import new_token

__all__ = ["head"]

CROWD = 10_000
OTHERS = 32  # descriptors and threads that a process may have more for reasons of its own
DRIP_SECONDS = 0.1  # between two bytes
RANDOM_CALLERS = 40  # at each port
TLS_RECORD = b"\x16\x03\x01\x40\x00"  # of a handshake, with 16 KiB to come
PORTS = ("client", "data", "waiting")


@pytest.fixture(scope="module", params=[Encryption.BETWEEN_MACHINES, Encryption.ALWAYS], ids=["plain", "TLS"])
def besieged(request: pytest.FixtureRequest, head: Path) -> Iterator[Besieged]:
    besieged = Besieged(head, request.param)
    try:
        yield besieged
    finally:
        besieged.close()


def answer(address: Address, said: bytes, ends: bool = False) -> bytes:
    """All that a caller who says this, and then nothing or the end, hears until the other end closes."""
    heard = b""
    with socket.create_connection(address, timeout=PATIENCE) as caller, suppress(ConnectionError):
        caller.sendall(said)
        if ends:
            with suppress(OSError):  # the other end has closed already
                caller.shutdown(socket.SHUT_WR)
        while piece := caller.recv(1 << 16):
            heard += piece
    return heard


@pytest.mark.parametrize("given", ["none of ours", "that of an earlier session"])
def test_nobody_comes_in_with_another_token(besieged: Besieged, given: str) -> None:
    token = new_token() if given == "none of ours" else besieged.earlier
    with besieged.drawing():
        for role in (Role.MAPSHADE_SERVER, Role.SPLAT_SERVER):
            with pytest.raises(VolsplatError, match="another session token"):
                besieged.dialled(role, token, besieged.session.address)
        with pytest.raises(VolsplatError, match="does not know the key that the client gave to worker"):
            besieged.dialled(Role.DATA_LINK, token, besieged.data, besieged.workers[0])
        with pytest.raises(VolsplatError, match="session token"):
            besieged.called(token, besieged.waits)


def test_the_session_token_alone_makes_nobody_a_worker_s_data_link(besieged: Besieged) -> None:
    with besieged.drawing():
        for worker in besieged.workers:
            with pytest.raises(VolsplatError, match="does not know the key that the client gave to worker"):
                besieged.dialled(Role.DATA_LINK, besieged.token, besieged.data, worker)
        with pytest.raises(PeerLost):  # it is told to try again later, should it be invited by then
            besieged.dialled(Role.DATA_LINK, besieged.token, besieged.data, max(besieged.workers) + 7)


@pytest.mark.parametrize("port", PORTS)
def test_whoever_speaks_tls_to_a_plain_port_or_plainly_to_tls_is_turned_away(besieged: Besieged, port: str) -> None:
    address = besieged.addresses[port]
    with besieged.drawing():
        if besieged.encryption is Encryption.ALWAYS:
            heard = answer(address, sample_bytes(Hello))
            assert b"TLS is asked for by one side alone" in heard
        else:
            with socket.create_connection(address, timeout=PATIENCE) as caller, pytest.raises((ssl.SSLError, OSError)):
                ssl._create_unverified_context().wrap_socket(caller)


def test_a_handshake_that_is_played_again_opens_nothing(besieged: Besieged) -> None:
    """Both sides of every handshake of this session: each is played to the port that it was for."""
    with Recorder(besieged.waits, HOST) as path:
        with besieged.called(besieged.token, path.address) as client:
            client.send(messages.EndSession())
        wait_until(lambda: path.recorded[0].over, "did the connection end")
        links = [(besieged.waits, bytes(path.recorded[0].dialler))]
    links += [(besieged.session.address, bytes(one.dialler)) for one in besieged.to_client.recorded]
    links += [(besieged.data, bytes(one.dialler)) for one in besieged.to_data.recorded]
    assert len(links) >= 6 and all(len(said) > 100 for _, said in links)
    with besieged.drawing():
        for address, said in links:
            welcome = answer(address, said)
            assert b"Welcome" not in welcome and len(welcome) < LARGEST_GREETING
        with played(bytes(besieged.to_client.recorded[0].accepter), HOST) as fake, pytest.raises(VolsplatError):
            besieged.dialled(Role.MAPSHADE_SERVER, besieged.token, fake)


FRAMES = {
    "control part": HEADER.pack(MAGIC, LARGEST_GREETING + 1, 0),
    "largest control part": HEADER.pack(MAGIC, (1 << 32) - 1, 0) + bytes(1 << 16),
    "payload": HEADER.pack(MAGIC, 64, 1),
    "largest payload": HEADER.pack(MAGIC, 64, (1 << 64) - 1) + bytes(1 << 16),
}


@pytest.mark.parametrize("port", PORTS)
def test_a_stranger_s_oversized_frame_is_read_no_further_than_its_header(besieged: Besieged, port: str) -> None:
    with besieged.drawing():
        for said in FRAMES.values():
            assert len(answer(besieged.addresses[port], said)) < LARGEST_GREETING
        assert len(answer(besieged.addresses[port], TLS_RECORD + bytes(1 << 16))) < LARGEST_GREETING


def broken(peer: Connection, control_bytes: int, payload_bytes: int) -> None:
    """Say what no header may, over an open connection; the other end must close it."""
    peer._channel.send([memoryview(HEADER.pack(MAGIC, control_bytes, payload_bytes))], None, 0)
    with suppress(VolsplatError):
        while peer.receive() is not None:
            pass
    assert peer.closed


@pytest.mark.parametrize("sizes", [(LARGEST_CONTROL + 1, 0), (64, LARGEST_PAYLOAD + 1)], ids=["control", "payload"])
def test_an_oversized_frame_of_who_has_the_token_ends_its_connection_alone(
    besieged: Besieged, sizes: tuple[int, int]
) -> None:
    with besieged.drawing():
        broken(besieged.dialled(Role.MAPSHADE_SERVER, besieged.token, besieged.session.address), *sizes)
        broken(besieged.called(besieged.token, besieged.waits), *sizes)
        with besieged.rogue_data_link() as link:
            broken(link, *sizes)
        with besieged.called(besieged.token, besieged.waits) as client:  # it waits for the next
            client.send(messages.EndSession())


@pytest.mark.parametrize("besieged", [Encryption.ALWAYS], indirect=True)
def test_ten_thousand_who_connect_and_say_nothing_take_what_few_do(besieged: Besieged) -> None:
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    if hard != resource.RLIM_INFINITY and hard < CROWD + OTHERS:
        pytest.skip(f"a process may have {hard} files open here, which is too few for {CROWD} connections")
    watched = [psutil.Process(), *besieged.processes.values()]
    with besieged.drawing() as drawing:
        before = taken_in(watched)
        command = [sys.executable, str(Path(__file__).with_name("crowd.py")), str(CROWD)]
        command += map(str, besieged.addresses.values())
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as crowd:
            assert crowd.stdout is not None and crowd.stdin is not None
            assert crowd.stdout.readline() == b"%d\n" % CROWD
            drawing.go_on()
            for pid, (files, threads) in taken_in(watched).items():
                assert files <= before[pid][0] + MOST_PENDING + OTHERS
                assert threads <= before[pid][1] + MOST_PENDING + OTHERS
            besieged.called(besieged.token, besieged.waits).close()  # who has the token comes in all the same
            crowd.stdin.close()
        wait_until(lambda: all(now[0] <= before[pid][0] for pid, now in taken_in(watched).items()), "are all closed")


def test_who_speaks_as_slowly_as_can_be_is_dropped_in_time(besieged: Besieged) -> None:
    """A byte at a time of what an honest caller says, and of a TLS handshake."""
    with besieged.drawing(), ExitStack() as stack:
        slow = [
            (stack.enter_context(socket.create_connection(address, timeout=PATIENCE)), said)
            for address in besieged.addresses.values()
            for said in (sample_bytes(Hello)[:-1], TLS_RECORD + bytes(1 << 10), b"")
        ]
        until = time.monotonic() + PATIENCE
        for n in count():
            slow = [(caller, said) for caller, said in slow if drips(caller, said[n : n + 1])]
            if not slow:
                return
            assert time.monotonic() < until, f"{len(slow)} callers are still let speak"


def drips(caller: socket.socket, byte: bytes) -> bool:
    """Whether the other end still lets it speak after this."""
    caller.settimeout(DRIP_SECONDS / len(PORTS) ** 2)
    try:
        caller.sendall(byte)
        while caller.recv(1 << 16):  # what a server that waits says first, or an alert
            pass
    except TimeoutError:
        return True
    except ConnectionError:
        return False
    return False


def test_random_bytes_are_answered_by_no_more_than_a_line(besieged: Besieged) -> None:
    seed = random.SystemRandom().randrange(1 << 32)
    print(f"seed {seed}")
    chance = random.Random(seed)
    hello = sample_bytes(Hello)
    with besieged.drawing():
        for address in besieged.addresses.values():
            for _ in range(RANDOM_CALLERS):
                begun = chance.choice(
                    (b"", hello[: chance.randrange(len(hello))], TLS_RECORD, HEADER.pack(MAGIC, 64, 0))
                )
                said = begun + chance.randbytes(chance.choice((1, 16, 300, 1 << 16)))
                assert len(answer(address, said, ends=True)) < LARGEST_GREETING, seed


@pytest.mark.skipif(not has_landlock(), reason=WITHOUT)
def test_names_that_lead_out_of_the_data_root_are_refused_while_frames_go_on(besieged: Besieged) -> None:
    outside = besieged.head.parent.parent / "outside.npy"
    np.save(outside, np.zeros((8, 8, 8), np.uint8))
    link = besieged.head.with_name(f"{besieged.encryption.name}.npy")
    link.symlink_to(outside)
    with besieged.drawing(), besieged.called(besieged.token, besieged.waits) as client:
        for name in (
            str(outside),
            "../outside.npy",
            link.name,
            f"{besieged.head.parent}/../outside.npy",
            "/etc/passwd",
        ):
            client.send(messages.DescribeVolume(name))
            received = client.receive()
            assert received is not None and isinstance(received.message, messages.Refused), name
            assert "below its --data-root alone" in received.message.cause
        client.send(messages.DescribeVolume(besieged.head.name))
        received = client.receive()
        assert received is not None and isinstance(received.message, messages.VolumeDescribed)
        client.send(messages.EndSession())
