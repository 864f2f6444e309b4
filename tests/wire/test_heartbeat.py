"""Who says nothing for too long is given up by name; who lives is not, nor is anyone for what is late on this side."""

import ctypes
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from support.patience import PATIENCE, wait_until
from volsplat.mapshade_server._kernels import SignsOfLife
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, Role
from volsplat.protocol.messages.session_messages import LEAST_SILENCE
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import encode
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.heartbeat import (
    LONGEST_STEP,
    MOST_OF_A_STEP,
    SILENCE_SECONDS,
    STEPS,
    UNTAKEN,
    Heartbeat,
    _Pulse,
    patience_with_client,
)
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tcp_info import Delivery
from volsplat.protocol.wire.tls_channel import TlsChannel
from volsplat.protocol.wire.tokens import new_token

ALIVE_BYTES = len(b"".join(encode(messages.Alive(2.0), speech=Speech(CLIENT_TO_MAPSHADE))))
HOSTS = ("127.0.0.1", "127.0.0.2") if sys.platform == "linux" else ("127.0.0.1",)  # by the door, by the port
WAYS = [(host, Encryption.BETWEEN_MACHINES) for host in HOSTS] + [(HOSTS[-1], Encryption.ALWAYS)]
BOX = Box((0, 0, 0), (1 << 20, 4, 1))


@pytest.fixture(params=WAYS, ids=str)
def ends(request: pytest.FixtureRequest) -> Iterator[tuple[Connection, Connection]]:
    """A client's connection to a map/shade server, and the server's."""
    with linked(*request.param) as ends:
        yield ends


@contextmanager
def linked(host: str, encryption: Encryption) -> Iterator[tuple[Connection, Connection]]:
    token = new_token()
    with Listener(Role.CLIENT, token, host=host, encryption=encryption) as listener:
        hello = new_hello(Role.MAPSHADE_SERVER)
        server = connect(listener.address, hello, token, Role.CLIENT, encryption=encryption)
        client = listener.accept(PATIENCE)
        assert client is not None
        with client, server:
            yield client, server


@contextmanager
def beating(silence: float = LEAST_SILENCE) -> Iterator[Heartbeat]:
    heartbeat = Heartbeat(silence)
    try:
        yield heartbeat
    finally:
        heartbeat.close()


def received(connection: Connection) -> threading.Thread:
    """A thread that takes all that comes, as each end of a connection has one."""

    def receive() -> None:
        try:
            while connection.receive() is not None:
                pass
        except PeerLost:
            pass

    thread = threading.Thread(target=receive, daemon=True)
    thread.start()
    return thread


def test_ends_that_have_nothing_to_say_keep_each_other(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    greetings = client.counters.messages_in
    with beating() as one, beating(8 * LEAST_SILENCE) as other:
        for heartbeat, connection in ((one, client), (other, server)):
            received(connection)
            heartbeat.keep(connection, lambda: PATIENCE)  # on a busy machine nothing shorter can be held to
        wait_until(lambda: server.peers_silence and client.peers_silence, "does each hear of the other's patience")
        assert (client.peers_silence, server.peers_silence) == (8 * LEAST_SILENCE, LEAST_SILENCE)
        heard = client.counters.bytes_in
        wait_until(lambda: client.counters.bytes_in > heard, "is more said though nothing is to be said")
        assert client.counters.messages_in == greetings, "nobody hears of it but the connection"
        client.send(messages.AbortFrame(1))
        client.send(messages.EndSession())
        said = client.counters.bytes_out
        client.say_alive(LEAST_SILENCE)
        assert client.counters.bytes_out == said, "nothing follows the end of the session"


def test_an_end_that_is_silent_is_given_up_by_name(ends: tuple[Connection, Connection]) -> None:
    client, _ = ends
    with beating() as heartbeat:
        began = time.monotonic()
        heartbeat.keep(client, lambda: LEAST_SILENCE)
        with pytest.raises(PeerLost, match=r"^map/shade server 1 .* has said nothing for 0\.5 s: it is frozen, "):
            client.receive()
        assert time.monotonic() - began >= LEAST_SILENCE / 2


def test_an_end_that_owes_no_sign_of_life_is_kept(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    with beating() as heartbeat:
        heartbeat.keep(server, None)
        heartbeat.keep(client, None)
        receivers = [received(client), received(server)]
        wait_until(lambda: server.counters.bytes_in > 8 * ALIVE_BYTES, "has it lasted for more than one silence")
        assert not client.closed and not server.closed
        client.close()
        for receiver in receivers:
            receiver.join(PATIENCE)


def test_a_connection_that_has_ended_is_not_kept(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    with beating() as heartbeat:
        heartbeat.keep(client, None)
        heartbeat.keep(server, None)
        client.close()
        wait_until(lambda: [pulse.connection for pulse in heartbeat._pulses] == [server], "is it let go")


def test_what_has_come_and_is_not_read_yet_counts_as_heard(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    looks = threading.Semaphore(0)

    def patience() -> float:
        looks.release()
        return LEAST_SILENCE

    with beating() as heartbeat:
        server.say_alive(LEAST_SILENCE)
        wait_until(lambda: client.unread, "has it come")
        heartbeat.keep(client, patience)
        for _ in range(3 * STEPS):
            assert looks.acquire(timeout=PATIENCE)
        assert not client.closed
        received(client)
        wait_until(lambda: client.closed, "is it given up once nothing more comes")


def test_a_record_of_tls_that_comes_in_more_slowly_than_silence_lasts_is_heard_while_it_comes() -> None:
    """Nothing of it can be decrypted before its last byte is here."""
    with linked(HOSTS[-1], Encryption.ALWAYS) as (client, server), beating() as heartbeat:
        rest = memoryview(encrypted(client, messages.AbortFrame(1)))
        looks = 0

        def patience() -> float:
            nonlocal rest, looks
            looks += 1
            if looks <= 3 * STEPS:
                came = server.came
                client._socket.sendall(rest[:1])
                rest = rest[1:]
                wait_until(lambda: server.came > came, "did it come")
            return LEAST_SILENCE

        received(server)
        heartbeat.keep(server, patience)
        wait_until(lambda: server.closed, "is it given up once nothing more comes")
        assert looks > 3 * STEPS and rest


def encrypted(connection: Connection, message: messages.Message) -> bytes:
    """What it would send."""
    channel = connection._channel
    assert isinstance(channel, TlsChannel)
    channel._tls.write(b"".join(encode(message, speech=connection._outgoing)))
    return channel._outgoing.read()


def test_what_was_decrypted_and_is_not_taken_yet_is_unread() -> None:
    with linked(HOSTS[-1], Encryption.ALWAYS) as (client, server):
        one, other, more = (encrypted(client, messages.AbortFrame(frame)) for frame in (1, 2, 3))
        client._socket.sendall(one + other)
        wait_until(lambda: server.unread, "has it come")
        for left in (True, False):
            assert server.receive() is not None
            assert server.unread == left
        came, receiver = server.came, received(server)
        client._socket.sendall(more[: len(more) // 2])
        wait_until(lambda: server.came > came and not server.unread, "is half a record nothing to be read")
        server.close()
        receiver.join(PATIENCE)


def test_nothing_is_unread_once_nobody_reads_any_more() -> None:
    with linked(HOSTS[-1], Encryption.ALWAYS) as (client, server):
        client._socket.sendall(b"".join(encrypted(client, messages.AbortFrame(frame)) for frame in (1, 2)))
        assert server.receive() is not None and server.unread
        server.close()
        assert not server.unread


def test_whoever_was_held_up_itself_counts_little_of_that_as_silence(ends: tuple[Connection, Connection]) -> None:
    client, _ = ends
    looks: list[float] = []

    def patience() -> float:
        looks.append(time.monotonic())
        if len(looks) == 1:
            time.sleep(3 * LEAST_SILENCE)  # as if the whole process had been stopped
        return LEAST_SILENCE

    with beating() as heartbeat:
        heartbeat.keep(client, patience)
        wait_until(lambda: client.closed, "is it given up in the end")
        assert len(looks) >= STEPS / MOST_OF_A_STEP


def test_neither_a_peer_that_does_not_read_nor_a_send_that_waits_delays_the_thread(
    ends: tuple[Connection, Connection],
) -> None:
    client, server = ends
    part = messages.VolumePart(server=2, sub_cube=0, scalar=0, scalar_type="uint8", box=BOX)
    payload = bytes(BOX.voxels)

    def flood() -> None:
        with pytest.raises(PeerLost, match="has said nothing"):
            while True:
                client.send(messages.HoldPart(1, part), payload)

    flooding = threading.Thread(target=flood, daemon=True)
    with beating() as heartbeat:
        flooding.start()
        wait_until(lambda: client.counters.bytes_out > 0 and client._sending.locked(), "does a send wait")
        heartbeat.keep(client, lambda: LEAST_SILENCE)
        flooding.join(PATIENCE)
        assert not flooding.is_alive() and client.closed


def hold_the_interpreter(seconds: float) -> None:
    """As a library does that does not let go of it while it reads: no other thread of Python's runs."""
    ctypes.PyDLL(None).usleep(ctypes.c_uint(int(seconds * 1e6)))


def test_life_is_signalled_though_a_library_holds_the_interpreter(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    heartbeat = Heartbeat(LEAST_SILENCE, SignsOfLife)
    server.peers_silence = 0.04  # it is told a hundred times a second
    try:
        for _ in range(2):
            with pytest.raises(BadInput), heartbeat.at_work(server), heartbeat.at_work(server):
                given = 0
                while given < 3:  # on a busy machine the thread may come late
                    server.send(messages.LeaveSession())
                    left = server.signs_left
                    hold_the_interpreter(0.1)
                    given = left - server.signs_left
                raise BadInput("the file is gone")
            assert server.signs_left == 0
    finally:
        heartbeat.close()
    heard = client.receive()
    assert heard is not None and heard.message == messages.LeaveSession()


def test_nobody_is_at_work_for_a_peer_that_is_gone(ends: tuple[Connection, Connection]) -> None:
    """However often it is tried: who went on would do it for nobody."""
    _, server = ends
    heartbeat = Heartbeat(LEAST_SILENCE, SignsOfLife)
    server.close()
    try:
        for _ in range(2):
            with pytest.raises(ConnectionClosed), heartbeat.at_work(server):
                pytest.fail("it was at work")
    finally:
        heartbeat.close()


def test_what_is_said_at_work_comes_in_order_behind_the_signs_that_were_left(
    ends: tuple[Connection, Connection],
) -> None:
    """On an encrypted connection signs that were made ready have their place in the stream."""
    client, server = ends
    frames = range(1, 200)

    def work() -> None:
        with server:
            server.leave_signs(LEAST_SILENCE, leave)
            for frame in frames:
                assert server.receive() is not None
                server.send(messages.FrameAborted(frame))
            server.leave_no_signs()

    def leave(socket: int, ready: Callable[[], bytes]) -> SignsOfLife:
        return SignsOfLife(socket, [ready() for _ in range(5)], 1e-5)

    working = threading.Thread(target=work)
    working.start()
    for frame in frames:
        client.send(messages.AbortFrame(frame))
        heard = client.receive()
        assert heard is not None and heard.message == messages.FrameAborted(frame)
    working.join(PATIENCE)


def test_signs_that_nobody_takes_are_left_and_end_with_the_connection(ends: tuple[Connection, Connection]) -> None:
    client, server = ends
    server.leave_signs(LEAST_SILENCE, lambda socket, ready: SignsOfLife(socket, [ready() for _ in range(10)], 1e-3))
    wait_until(lambda: not server.signs_left, "are they given")
    client.close()
    with pytest.raises(PeerLost, match="is gone"):
        server.receive()
    assert server.closed
    with pytest.raises(PeerLost, match="is gone"):
        server.leave_no_signs()


Told = list[Delivery]  # what the system says of delivery, from now on; the last one is the newest


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    told = [Delivery(sends_again=True, taken=1000)]
    monkeypatch.setattr(Connection, "delivery", property(lambda connection: told[-1]))
    return told


def lasts(pulse: _Pulse, seconds: float) -> bool:
    """Whether the connection is open once so much time has passed, by steps of which none is missing."""
    for _ in range(round(seconds / LONGEST_STEP)):
        pulse.beat(LONGEST_STEP, SILENCE_SECONDS)
    return not pulse.connection.closed


@pytest.mark.parametrize("patience", [None, 3 * UNTAKEN * SILENCE_SECONDS])
def test_a_peer_that_is_heard_is_given_up_once_the_network_has_swallowed_the_same_for_long(
    ends: tuple[Connection, Connection], told: Told, patience: float | None
) -> None:
    """For as long as it may be silent, if that is longer."""
    client, server = ends
    server.send(messages.LeaveSession())
    wait_until(lambda: client.unread, "is it heard")
    limit = patience or UNTAKEN * SILENCE_SECONDS
    pulse = _Pulse(client, None if patience is None else lambda: limit)
    assert lasts(pulse, LONGEST_STEP)  # what was taken before is not known
    assert lasts(pulse, limit - LONGEST_STEP)
    assert not lasts(pulse, LONGEST_STEP)
    with pytest.raises(PeerLost, match=r"lets packets of full size through \(MTU\)"):
        client.send(messages.AbortFrame(1))


@pytest.mark.parametrize(("sends_again", "more"), [(True, 1), (False, 0)], ids=["more is taken", "nothing is lost"])
def test_what_arrives_late_or_is_only_not_read_counts_as_delivered(
    ends: tuple[Connection, Connection], told: Told, sends_again: bool, more: int
) -> None:
    client, _ = ends
    pulse = _Pulse(client, None)
    assert lasts(pulse, LONGEST_STEP)
    for _ in range(3):
        assert lasts(pulse, UNTAKEN * SILENCE_SECONDS - LONGEST_STEP)
        taken = told[-1].taken + more
        told.append(Delivery(sends_again, taken))
        assert lasts(pulse, LONGEST_STEP)
        told.append(Delivery(sends_again=True, taken=taken))
    told.append(Delivery(sends_again=False, taken=told[-1].taken))
    assert lasts(pulse, 10 * UNTAKEN * SILENCE_SECONDS)


def test_a_server_judges_no_client_of_its_own_machine(ends: tuple[Connection, Connection]) -> None:
    _, server = ends
    patience = patience_with_client(server, 2.0)
    assert (patience is None) == server.may_share_memory
    assert patience is None or patience() == 30.0
