"""Connections over real sockets: messages, back-pressure, loss, strangers."""

import logging
import os
import queue
import re
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import msgspec
import pytest

from support.messages.message_samples import SAMPLES, framed, sample_bytes
from support.patience import PATIENCE, wait_until
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.greetings import Hello
from volsplat.protocol.messages.messages import AbortFrame, Batch, Message
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.versions import SPOKEN, VersionRange
from volsplat.protocol.text.errors import BadInput, LocalProtocolError, PeerLost, RemoteProtocolError
from volsplat.protocol.text.rare_lines import MOST_AT_ONCE, RareLines
from volsplat.protocol.wire.accepting import Accepter
from volsplat.protocol.wire.addresses import LOOPBACK, Address, parse_address
from volsplat.protocol.wire.connection import OWN_OUTPUT, SHORT_MESSAGE, Connection, ConnectionClosed
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import Allocate, new_buffer
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.peer import Peer
from volsplat.protocol.wire.port import Port
from volsplat.protocol.wire.socket_options import TIMEVAL
from volsplat.protocol.wire.tokens import new_token

TOKEN = new_token()
BRIEF = 2.0  # seconds for a handshake that shall fail; honest ones take milliseconds
DOORS = sys.platform == "linux"
HOSTS = {"by the door": LOOPBACK, "by the port": "127.0.0.2"} if DOORS else {"by the port": LOOPBACK}
BY_PORT = r"at 127.0.0.1:\d+"
CALLERS = {LOOPBACK: "on this machine" if DOORS else BY_PORT, "127.0.0.2": BY_PORT}  # as listeners call them
BIG = 16 << 20  # bytes: more than loopback's buffers hold


class Lines(logging.Handler):
    """The listener's log, to be waited on."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.seen: queue.SimpleQueue[str] = queue.SimpleQueue()

    def emit(self, record: logging.LogRecord) -> None:
        self.seen.put(record.getMessage())

    def next(self) -> str:
        line = self.seen.get(timeout=PATIENCE)
        assert "\n" not in line
        return line


@pytest.fixture(params=list(HOSTS.values()), ids=list(HOSTS))
def host(request: pytest.FixtureRequest) -> str:
    """Where listeners listen: once for callers who come by the Unix socket, and once for others."""
    return str(request.param)


@pytest.fixture
def lines() -> Iterator[Lines]:
    handler = Lines()
    logger = logging.getLogger("volsplat.protocol.wire.port")
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)
    assert handler.seen.empty(), f"one more line: {handler.seen.get()}"


def joined(listener: Listener, role: Role = Role.MAPSHADE_SERVER, server: int = 0) -> tuple[Connection, Connection]:
    """Both ends of a new connection: the dialler's, then the accepter's."""
    expected = Role.SPLAT_SERVER if role is Role.DATA_LINK else Role.CLIENT
    near = connect(listener.address, new_hello(role, server=server), TOKEN, expected, patience=0)
    far = listener.accept(timeout=PATIENCE)
    assert far is not None
    return near, far


@contextmanager
def data_link(host: str, allocate: Allocate = new_buffer) -> Iterator[tuple[Connection, Connection]]:
    with Listener(Role.SPLAT_SERVER, TOKEN, host=host, allocate=allocate) as listener:
        near, far = joined(listener, Role.DATA_LINK, server=4)
        with near, far:
            yield near, far


@contextmanager
def in_thread(work: Callable[[], object]) -> Iterator["queue.SimpleQueue[object]"]:
    """Run `work` beside the test; the queue gets its result, or the exception that ended it."""
    results: queue.SimpleQueue[object] = queue.SimpleQueue()

    def body() -> None:
        try:
            results.put(work())
        except Exception as error:
            results.put(error)

    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    yield results
    thread.join(PATIENCE)
    assert not thread.is_alive()


def batch(packets: int, sequence: int = 0) -> Batch:
    return Batch(1, 4, 0, sequence, 0, [messages.BatchPart(1, packets)], 0, 0, False)


def payload_of(packets: int, fill: int = 0) -> bytearray:
    return bytearray([fill % 251]) * (24 + 8 * packets)


def expect(connection: Connection) -> Message:
    received = connection.receive()
    assert received is not None
    return received.message


def silent(connection: socket.socket) -> bool:
    """True once the other side has closed without a word."""
    connection.settimeout(PATIENCE)
    try:
        return connection.recv(1) == b""
    except ConnectionResetError:
        return True


def test_messages_go_both_ways_and_each_side_knows_the_other(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        hello = new_hello(Role.SPLAT_SERVER, data_port=7001, name="node7")
        near = connect(listener.address, hello, TOKEN, Role.CLIENT)
        far = listener.accept(PATIENCE)
        assert far is not None
        with near, far:
            assert (far.peer.role, far.peer.id, far.peer.name) == (Role.SPLAT_SERVER, 1, "node7")
            assert (far.peer.data_host, far.peer.data_port) == (LOOPBACK, 7001)
            assert (near.peer.role, near.peer.id, near.id) == (Role.CLIENT, 0, 1)
            assert near.peer.version == SPOKEN.newest
            assert re.fullmatch(rf"splat server 1 \(node7\) {CALLERS[host]}", str(far.peer))
            far.send(messages.ReadImage(7))
            assert expect(near) == messages.ReadImage(7)
            image, pixels = SAMPLES[messages.ImageRead]
            near.send(image, pixels)
            received = far.receive()
            assert received is not None and (received.message, bytes(received.payload)) == (image, pixels)


def test_servers_get_ids_that_are_never_used_again_and_data_links_keep_theirs(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        for number in (1, 2, 3):
            near, far = joined(listener)
            assert near.id == far.peer.id == number
            near.close()
            far.close()
    with data_link(host) as (near, far):
        assert near.id == far.peer.id == 4


def test_a_listener_may_turn_a_proven_peer_away(host: str, lines: Lines) -> None:
    def full(hello: Hello) -> int:
        raise BadInput("there is no room for another map/shade server")

    with Listener(Role.CLIENT, TOKEN, host=host, assign_id=full) as listener, pytest.raises(BadInput, match="no room"):
        connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
    assert "no room" in lines.next()


def test_payloads_arrive_in_the_memory_that_was_given_and_are_counted(host: str) -> None:
    memory = bytearray(BIG)
    with data_link(host, lambda message, nbytes: memory) as (near, far):
        packets = (BIG - 24) // 8
        payload = payload_of(packets, 7)
        with in_thread(lambda: near.send(batch(packets), payload)):
            received = far.receive()
        assert received is not None and received.payload.obj is memory
        assert memory[: len(payload)] == payload
        assert near.counters.bytes_out == far.counters.bytes_in > BIG
        assert near.counters.messages_out == far.counters.messages_in


def test_time_blocked_in_a_send_is_counted_and_only_that(host: str) -> None:
    with data_link(host) as (near, far):
        near.send(batch(1), payload_of(1))
        assert near.counters.seconds_in_send == 0
        packets, sent = (BIG - 24) // 8, near.counters.bytes_out
        with in_thread(lambda: near.send(batch(packets), payload_of(packets))):
            wait_until(lambda: near.counters.bytes_out != sent, "full")
            while far.counters.bytes_in < BIG:
                far.receive()
        assert near.counters.seconds_in_send > 0


def test_many_payload_buffers_go_out_in_order(host: str) -> None:
    packets = 6000
    payload = bytes(n % 256 for n in range(24 + 8 * packets))
    with data_link(host) as (near, far):
        with in_thread(lambda: near.send(batch(packets), *(payload[n : n + 8] for n in range(0, len(payload), 8)))):
            received = far.receive()
        assert received is not None and received.payload == payload


def test_messages_of_several_threads_do_not_mix(host: str) -> None:
    each, threads = 40, 4
    with data_link(host) as (near, far):

        def send(thread: int) -> Callable[[], None]:
            def body() -> None:
                for n in range(each):
                    packets = 1 + 997 * (n % 7)
                    near.send(batch(packets, sequence=thread * each + n), payload_of(packets, thread * each + n))

            return body

        seen = set()
        with in_thread(send(0)), in_thread(send(1)), in_thread(send(2)), in_thread(send(3)):
            for _ in range(each * threads):
                received = far.receive()
                assert received is not None and isinstance(received.message, Batch)
                assert received.payload == payload_of(received.message.parts[0].packet_count, received.message.sequence)
                seen.add(received.message.sequence)
        assert len(seen) == each * threads


def test_what_is_sent_at_once_waits_for_nobody(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        server, client = joined(listener)
        with server, client:
            sent = 0
            while client.send_at_once(messages.NameSession(str(sent))):  # nobody reads
                sent += 1
            assert sent > 0
            for number in range(sent):
                assert expect(server) == messages.NameSession(str(number))
            assert client.send_at_once(messages.NameSession("again"))
            assert expect(server) == messages.NameSession("again")


def test_nothing_is_sent_at_once_amid_another_message_nor_if_it_is_long(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        server, client = joined(listener)
        with server, client:
            frame = SAMPLES[messages.RenderFrame][0]
            assert isinstance(frame, messages.RenderFrame)
            many = msgspec.structs.replace(frame, workers=dict.fromkeys(range(1, 1000), 1))
            assert len(encode_control(many)) > SHORT_MESSAGE
            assert not client.send_at_once(many)
            box = Box((0, 0, 0), (BIG, 1, 1))
            part = messages.HoldPart(
                1, messages.VolumePart(server=2, sub_cube=0, scalar=0, scalar_type="uint8", box=box)
            )
            before = client.counters.bytes_out
            with in_thread(lambda: client.send(part, bytes(BIG))) as result:
                wait_until(lambda: client.counters.bytes_out > before, "begun")
                assert not client.send_at_once(messages.NameSession("amid"))
                assert expect(server) == part
                assert result.get(timeout=PATIENCE) is None


def test_close_wakes_a_blocked_receive(host: str) -> None:
    with data_link(host) as (_, far):
        with in_thread(far.receive) as result:
            far.close()
            assert result.get(timeout=PATIENCE) is None
        assert far.receive() is None


def test_close_wakes_a_blocked_send(host: str) -> None:
    with data_link(host) as (near, far):
        packets = (BIG - 24) // 8

        def send_on() -> None:
            while True:
                near.send(batch(packets), payload_of(packets))

        with in_thread(send_on) as result:
            assert expect(far) == batch(packets)  # from here on nobody reads
            near.close()
            assert isinstance(result.get(timeout=PATIENCE), ConnectionClosed)
        with pytest.raises(ConnectionClosed, match="splat server"):
            near.send(batch(1), payload_of(1))


def test_a_connection_that_was_closed_during_its_handshake_does_not_open() -> None:
    near, far = socket.socketpair()
    with near, far:
        connection = Connection(near, "the peer")
        connection.close()
        with pytest.raises(ConnectionClosed, match="the peer"):
            connection.open(Peer(Role.CLIENT, LOOPBACK, 1), Role.SPLAT_SERVER, 1)
        assert not connection.opened


def test_a_peer_that_closes_is_lost_by_name(host: str) -> None:
    with data_link(host) as (near, far):
        near.close()
        with pytest.raises(PeerLost, match=f"map/shade data link 4 {CALLERS[host]} is gone: it closed the connection;"):
            far.receive()
        assert far.closed


def test_a_peer_that_dies_within_a_message_is_lost_by_name(host: str) -> None:
    with data_link(host) as (near, far):
        near._socket.sendall(framed(encode_control(batch(1)), bytes(payload_of(1)))[:-1])
        near.close()
        with pytest.raises(PeerLost, match="data link 4 .* in the middle of a message"):
            far.receive()


def test_sending_to_a_lost_peer_fails_by_name(host: str) -> None:
    with data_link(host) as (near, far):
        far.close()
        packets = (BIG - 24) // 8
        with pytest.raises(PeerLost, match="splat server at .* is gone"):
            while True:
                near.send(batch(packets), payload_of(packets))


def test_a_peer_that_takes_nothing_for_too_long_is_lost_by_name(host: str) -> None:
    with data_link(host) as (near, far):
        near.lose_after(BRIEF)
        with pytest.raises(PeerLost, match="splat server at .* is gone: what is sent to it does not arrive"):
            near.send(batch((BIG - 24) // 8), payload_of((BIG - 24) // 8))
        assert near.closed and not far.closed


@pytest.mark.skipif(not hasattr(socket, "TCP_USER_TIMEOUT"), reason="this system has no such limit over TCP")
def test_the_system_is_told_for_how_long_a_peer_may_take_nothing(host: str) -> None:
    with data_link(host) as (near, _):
        near.lose_after(2.5)
        assert limit_of(near) == 2.5


def limit_of(connection: Connection) -> float:
    """Seconds after which the system gives up a peer that takes nothing."""
    asked = connection._socket
    if asked.family == socket.AF_UNIX:
        seconds, microseconds = TIMEVAL.unpack(asked.getsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, TIMEVAL.size))
        return float(seconds + microseconds / 1e6)
    return asked.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) / 1000


def test_a_peer_that_breaks_the_protocol_is_cut_off_by_name(host: str) -> None:
    with data_link(host) as (near, far):
        near._socket.sendall(framed(encode_control(AbortFrame(1))))
        with pytest.raises(
            RemoteProtocolError, match=f"data link 4 {CALLERS[host]} broke the protocol: AbortFrame came from"
        ):
            far.receive()
        assert far.closed
        assert silent(near._socket)


def test_what_the_rules_forbid_is_not_sent_and_the_connection_lives(host: str) -> None:
    with data_link(host) as (near, far):
        with pytest.raises(LocalProtocolError, match="AbortFrame"):
            near.send(AbortFrame(1))
        with pytest.raises(LocalProtocolError, match="announces"):
            near.send(batch(1), b"short")
        near.send(batch(1), payload_of(1))
        assert expect(far) == batch(1)


def test_another_token_ends_in_one_line_on_both_sides(host: str, lines: Lines) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        with pytest.raises(BadInput, match="cannot join the client at .*another session token") as caught:
            connect(listener.address, new_hello(Role.MAPSHADE_SERVER), new_token(), Role.CLIENT)
        assert "\n" not in str(caught.value)
        assert "another session token" in lines.next()


def test_another_version_ends_in_one_line_on_both_sides(host: str, lines: Lines) -> None:
    later = VersionRange(SPOKEN.newest + 1, SPOKEN.newest + 2)
    with Port(Accepter(Role.CLIENT, TOKEN, versions=later).greet, host, 0) as listener:
        with pytest.raises(BadInput, match=f"{SPOKEN},.*{later}"):
            connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        line = lines.next()
        assert f"{SPOKEN}," in line and f"{later}" in line


def test_a_listener_without_the_token_gets_nothing(host: str, lines: Lines) -> None:
    with Listener(Role.CLIENT, new_token(), host=host) as impostor:
        with pytest.raises(BadInput):
            connect(impostor.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        assert impostor.accept(timeout=0) is None
        lines.next()


@pytest.mark.parametrize(
    "garbage",
    [b"GET / HTTP/1.1\r\nHost: here\r\n\r\n", bytes(64), b"VSPL" + b"\xff" * 12, sample_bytes(messages.EndSession)],
    ids=["http", "zeros", "lengths", "too early"],
)
def test_garbage_ends_in_one_line_and_a_closed_connection_and_troubles_no_other(
    host: str, garbage: bytes, lines: Lines
) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        near, far = joined(listener)
        with near, far, socket.create_connection(listener.address) as stranger:
            stranger.sendall(garbage)
            assert silent(stranger)
            line = lines.next()
            assert f"{LOOPBACK}:{stranger.getsockname()[1]}" in line and "the connection is closed" in line
            far.send(AbortFrame(1))
            assert expect(near) == AbortFrame(1)
            for end in joined(listener):
                end.close()


def test_a_stranger_who_says_nothing_is_dropped_in_time_and_holds_up_nobody(host: str, lines: Lines) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host, handshake_seconds=BRIEF) as listener:
        with socket.create_connection(listener.address) as stranger:
            near, far = joined(listener)
            with near, far:
                assert silent(stranger)
                assert "did not finish the handshake in time" in lines.next()
                far.send(AbortFrame(1))  # the limit is lifted for those who are in
                assert expect(near) == AbortFrame(1)


def test_a_stranger_who_drips_bytes_gains_no_time(host: str, lines: Lines) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host, handshake_seconds=BRIEF) as listener:
        with socket.create_connection(listener.address) as stranger:
            stranger.settimeout(BRIEF / 10)
            closed = False
            for byte in sample_bytes(Hello)[:100]:  # ten times as long as it has
                try:
                    stranger.sendall(bytes([byte]))
                    closed = stranger.recv(1) == b""
                except TimeoutError:
                    continue
                except OSError:
                    closed = True
                if closed:
                    break
            assert closed
            lines.next()


def test_only_so_many_strangers_wait_and_the_oldest_makes_room(host: str, lines: Lines) -> None:
    most = 3
    with Listener(Role.CLIENT, TOKEN, host=host, handshake_seconds=PATIENCE, most_pending=most) as listener:
        strangers = [socket.create_connection(listener.address) for _ in range(most)]
        wait_until(lambda: len(listener._pending) >= most, "so many")
        near, far = joined(listener)
        with near, far:
            assert silent(strangers[0])
            assert "3 handshakes are waiting" in lines.next()
        for stranger in strangers:
            stranger.close()
        for _ in strangers[1:]:
            assert "is gone" in lines.next()


def test_closing_a_listener_ends_handshakes_and_wakes_accept(host: str) -> None:
    listener = Listener(Role.CLIENT, TOKEN, host=host, handshake_seconds=PATIENCE)
    with socket.create_connection(listener.address) as stranger, in_thread(listener.accept) as result:
        listener.close()
        assert result.get(timeout=PATIENCE) is None
        assert silent(stranger)
    assert listener.accept() is None
    listener.close()
    with pytest.raises(PeerLost, match="nobody listens there"):
        connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT, patience=0)


class HeldUp(Listener):
    """A listener whose thread is held up between a call and its handshake."""

    def __init__(self, host: str) -> None:
        self.called, self.goes_on = threading.Event(), threading.Event()
        super().__init__(Role.CLIENT, TOKEN, host=host, handshake_seconds=2 * PATIENCE)

    def _begin(self, caller: socket.socket, address: Address) -> None:
        self.called.set()
        self.goes_on.wait(PATIENCE)
        super()._begin(caller, address)


def test_closing_a_listener_ends_also_what_comes_at_that_moment(host: str) -> None:
    listener = HeldUp(host)
    with socket.create_connection(listener.address) as stranger:
        assert listener.called.wait(PATIENCE)
        with in_thread(listener.close):
            assert listener._closing.wait(PATIENCE)
            with listener._lock:
                listener.goes_on.set()
        assert silent(stranger)


def test_a_port_in_use_is_one_clear_line(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        port = listener.address.port
        with pytest.raises(BadInput, match=f"port {port} at {host} is already in use; choose another"):
            Listener(Role.CLIENT, TOKEN, host=host, port=port)


@pytest.mark.parametrize("host", ["no.such.host.invalid", "192.0.2.1"])
def test_an_address_that_is_not_ours_is_one_clear_line(host: str) -> None:
    with pytest.raises(BadInput, match=f"cannot listen at {host}:0: "):
        Listener(Role.CLIENT, TOKEN, host=host)


@pytest.mark.parametrize("name", ["no.such.host.invalid", f"{'long' * 16}.invalid"])  # which no name may be
def test_an_unknown_name_is_one_clear_line(name: str) -> None:
    with pytest.raises(BadInput, match=f"cannot find the client at {name}:1: .* unknown"):
        connect(Address(name, 1), new_hello(Role.SPLAT_SERVER), TOKEN, Role.CLIENT)


def test_a_server_may_be_started_before_its_client(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as earlier:
        address = earlier.address
    hello = new_hello(Role.SPLAT_SERVER)
    with in_thread(lambda: connect(address, hello, TOKEN, Role.CLIENT, patience=PATIENCE)) as result:
        with Listener(Role.CLIENT, TOKEN, host=host, port=address.port) as listener:
            far = listener.accept(PATIENCE)
            near = result.get(timeout=PATIENCE)
            assert isinstance(near, Connection) and far is not None
            near.close()
            far.close()


def test_something_else_that_listens_is_told_apart() -> None:
    with socket.create_server((LOOPBACK, 0)) as other:
        address = Address(*other.getsockname()[:2])

        def answer() -> None:
            caller, _ = other.accept()
            with caller:
                caller.recv(1000)
                caller.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        with in_thread(answer), pytest.raises(RemoteProtocolError, match="client at .* broke the protocol: magic"):
            connect(address, new_hello(Role.SPLAT_SERVER), TOKEN, Role.CLIENT)


def test_a_listener_that_says_nothing_is_given_up() -> None:
    with socket.create_server((LOOPBACK, 0)) as other:
        address = Address(*other.getsockname()[:2])
        with pytest.raises(PeerLost, match="client at .* did not finish the handshake in time"):
            connect(address, new_hello(Role.SPLAT_SERVER), TOKEN, Role.CLIENT, patience=0, handshake_seconds=BRIEF)


SQUATTER = """
import os, socket, sys
os.setuid(65534)
squatter = socket.socket(socket.AF_UNIX)
squatter.bind(sys.argv[1].replace("@", chr(0)))
squatter.listen()
print("there", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(not DOORS, reason="only Linux has doors")
def test_a_door_with_a_crowd_before_it_is_passed_by() -> None:
    with Listener(Role.CLIENT, TOKEN) as earlier:
        address = earlier.address
    name = f"\0volsplat {os.geteuid()} {address}"
    with socket.socket(socket.AF_UNIX) as deaf, socket.socket(socket.AF_UNIX) as crowd:
        deaf.bind(name)
        deaf.listen(0)
        crowd.connect(name)
        with Listener(Role.CLIENT, TOKEN, port=address.port) as listener:
            near, far = joined(listener)
            with near, far:
                assert far.peer.port != 0


@pytest.mark.skipif(not DOORS or os.geteuid() != 0, reason="needs root, to be another user, on Linux")
def test_a_door_that_another_user_has_taken_is_passed_by() -> None:
    with Listener(Role.CLIENT, TOKEN) as earlier:
        address = earlier.address
    command = [sys.executable, "-c", SQUATTER, f"@volsplat {os.geteuid()} {address}"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as squatter:
        assert squatter.stdout is not None and squatter.stdout.readline() == b"there\n"
        with Listener(Role.CLIENT, TOKEN, port=address.port) as listener:
            near, far = joined(listener)
            with near, far:
                assert far.peer.port != 0
        squatter.communicate()


CALLER = """
import os, socket, sys
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as caller:
    caller.connect("\\0" + sys.argv[1])
    caller.settimeout(float(sys.argv[2]))
    print(caller.recv(1) == b"", flush=True)
"""


@pytest.mark.skipif(not DOORS or os.geteuid() != 0, reason="needs root, to be another user, on Linux")
def test_a_caller_of_another_user_is_turned_away_at_the_door(lines: Lines) -> None:
    with Listener(Role.CLIENT, TOKEN, handshake_seconds=PATIENCE) as listener:
        name = f"volsplat {os.geteuid()} {listener.address}"
        command = [sys.executable, "-c", CALLER, name, str(PATIENCE)]
        told = subprocess.run(command, capture_output=True, timeout=PATIENCE)
        assert told.stdout == b"True\n", told.stderr
        assert "is another user of this machine" in lines.next()
        for end in joined(listener):
            end.close()


def test_strangers_cause_few_lines_and_the_rest_is_counted(host: str, lines: Lines) -> None:
    strangers = 3 * MOST_AT_ONCE
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        for _ in range(strangers):
            with socket.create_connection(listener.address) as stranger:
                stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
                assert silent(stranger)
    said = []
    while not lines.seen.empty():
        said.append(lines.next())
    counts = [int(line.split()[0]) for line in said if line.endswith("more lines of this kind were left out")]
    others = len(said) - len(counts)
    assert MOST_AT_ONCE <= others < strangers and sum(counts) + others == strangers


def test_who_comes_while_memory_is_short_is_dropped_and_the_next_is_let_in(host: str, lines: Lines) -> None:
    came = list[Hello]()

    def assigned(hello: Hello) -> int:
        came.append(hello)
        if len(came) == 1:
            raise MemoryError
        return 7

    with Listener(Role.CLIENT, TOKEN, host=host, assign_id=assigned) as listener:
        dialled = connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        taken = listener.accept(PATIENCE)
        assert taken is not None and taken.peer.id == 7
        assert re.search(f"{CALLERS[host]} is dropped: this process has no memory left for it", lines.next())
        dialled.close()
        taken.close()


def test_what_was_left_out_is_counted_though_nobody_calls_any_more(
    lines: Lines, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("volsplat.protocol.text.rare_lines.SECONDS_A_LINE", 0.05)
    rare = RareLines(logging.getLogger("volsplat.protocol.wire.port"))
    for _ in range(10 * MOST_AT_ONCE):
        rare.warn("nonsense")
    last = ""
    while "left out" not in last:
        last = lines.next()
    rare.close()
    while not lines.seen.empty():
        lines.next()


def test_after_the_end_nothing_is_said_by_itself() -> None:
    rare = RareLines(logging.getLogger("volsplat.protocol.wire.port"))
    rare.close()
    for _ in range(2 * MOST_AT_ONCE):
        rare.warn("nonsense")
    assert rare._timer is None and rare._left_out > 0


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts open files by /proc/self/fd, which is Linux")
def test_no_socket_is_left_open(host: str) -> None:
    def open_files() -> int:
        return len(os.listdir("/proc/self/fd"))

    before = open_files()
    for _ in range(5):
        with Listener(Role.CLIENT, TOKEN, host=host) as listener:
            near, far = joined(listener)
            near.close()
            with pytest.raises(PeerLost):
                far.receive()
            unclaimed = connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        unclaimed.close()
    wait_until(lambda: open_files() <= before, "without a socket of its own")  # earlier tests' may close meanwhile


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("node7:7000", ("node7", 7000)),
        (":7000", (LOOPBACK, 7000)),
        ("[::1]:0", ("::1", 0)),
        ("0.0.0.0:65535", ("0.0.0.0", 65535)),
    ],
)
def test_an_address_is_read_as_written(text: str, address: tuple[str, int]) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize("text", ["", "node7", "7000", "node7:", "node7:x", "node7:65536", "::1:7000", "node7:-1"])
def test_what_is_no_address_is_one_clear_line(text: str) -> None:
    with pytest.raises(BadInput, match="HOST:PORT"):
        parse_address(text)


def test_a_loss_that_a_send_finds_first_is_told_by_receiving_too(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        near = connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        far = listener.accept(PATIENCE)
        assert far is not None
        with near, far:
            near.close()
            with pytest.raises(PeerLost) as found:
                while True:
                    far.send(messages.DescribeMachine())
            with pytest.raises(PeerLost) as told:
                far.receive()
            assert str(told.value) == str(found.value)
            far.close()
            with pytest.raises(PeerLost):
                far.receive()


def test_a_connection_that_this_side_closes_ends_quietly(host: str) -> None:
    with Listener(Role.CLIENT, TOKEN, host=host) as listener:
        near = connect(listener.address, new_hello(Role.MAPSHADE_SERVER), TOKEN, Role.CLIENT)
        with near:
            near.close()
            assert near.receive() is None


@pytest.mark.parametrize("resets", [False, True])
def test_who_has_never_said_anything_is_not_said_to_tell_why_it_ended(resets: bool) -> None:
    """It may be a scanner of ports."""
    with socket.create_server((LOOPBACK, 0)) as listening:
        caller = socket.create_connection(listening.getsockname())
        with Connection(listening.accept()[0], "whoever dials") as connection:
            caller.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", resets, 0))
            caller.close()
            with pytest.raises(PeerLost, match="whoever dials is gone: ") as told:
                connection.receive()
    assert OWN_OUTPUT not in str(told.value)


def test_whoever_sees_a_breach_of_the_protocol_at_any_moment_sees_what_it_was() -> None:
    near, far = socket.socketpair(socket.AF_UNIX)
    connection, seen = Connection(near, "the client"), set[tuple[bool, str]]()

    def look(_frame: FrameType, _event: str, _: object) -> Any:
        loss = connection.loss  # first, as who decides by both does
        seen.add((connection.broken, loss or connection.loss))
        return look

    far.sendall(bytes(16))
    before = sys.gettrace()
    with far, connection, pytest.raises(RemoteProtocolError, match="the client broke the protocol: magic"):
        sys.settrace(look)
        try:
            connection.receive()
        finally:
            sys.settrace(before)
    (told,) = {loss for broken, loss in seen if broken}
    assert told.startswith("the client broke the protocol: magic")
    assert {loss for broken, loss in seen if not broken} == {""}
