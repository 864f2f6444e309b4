"""TLS links: which are encrypted, that they carry messages whole both ways at once, and that strangers are noticed."""

import socket
import ssl
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.patience import PATIENCE, wait_until
from support.thoroughness import examples
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, VolsplatError
from volsplat.protocol.wire.addresses import LOOPBACK, Address
from volsplat.protocol.wire.certificates import accepting_context, dialling_context
from volsplat.protocol.wire.channel import unsent
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tls_channel import TlsChannel
from volsplat.protocol.wire.tokens import Token, new_token

BESIDE = "127.0.0.2"  # no Unix socket leads to a listener there


@contextmanager
def listening(token: Token, encryption: Encryption, seconds: float = PATIENCE) -> Iterator[Listener]:
    with Listener(Role.CLIENT, token, host=BESIDE, encryption=encryption, handshake_seconds=seconds) as listener:
        yield listener


def dialled(address: Address, token: Token, encryption: Encryption) -> Connection:
    return connect(
        address, new_hello(Role.SPLAT_SERVER), token, Role.CLIENT, encryption=encryption, patience=0,
        handshake_seconds=PATIENCE,
    )  # fmt: skip


def of_machine() -> str | None:
    """An address of this machine's that is not loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
        probe.connect(("192.0.2.1", 9))
        return str(probe.getsockname()[0])
    return None


@pytest.mark.parametrize("speaks_tls", [True, False])
def test_who_leaves_in_the_handshake_is_suspected_of_no_tls_only_if_it_spoke_none(speaks_tls: bool) -> None:
    one, other = socket.socketpair()
    with one, other:
        if speaks_tls:
            greeting = ssl.MemoryBIO()
            caller = dialling_context().wrap_bio(ssl.MemoryBIO(), greeting)
            with suppress(ssl.SSLWantReadError):
                caller.do_handshake()
            other.sendall(greeting.read())
        other.shutdown(socket.SHUT_WR)
        with pytest.raises(ConnectionResetError, match="it ended the TLS handshake") as told:
            TlsChannel(one, lambda: None, accepts=True).shake_hands()
        assert ("asked for by one side alone" in str(told.value)) is not speaks_tls


buffer_lists = st.lists(st.binary(max_size=70_000), min_size=1, max_size=20)


@given(buffer_lists, buffer_lists, st.sampled_from([0, socket.MSG_DONTWAIT]))
@settings(max_examples=examples(40), deadline=None)
def test_what_is_sent_both_ways_at_once_arrives_whole(there: list[bytes], back: list[bytes], flags: int) -> None:
    with shaken() as (near, far), ThreadPoolExecutor(4) as threads:
        sent = [threads.submit(send_all, *one, flags) for one in ((near, there), (far, back))]
        come = [threads.submit(receive_all, end, sum(map(len, said))) for end, said in ((far, there), (near, back))]
        assert [one.result(PATIENCE) for one in come] == [b"".join(there), b"".join(back)]
        assert not any(one.result(PATIENCE) for one in sent)


@contextmanager
def shaken() -> Iterator[tuple[TlsChannel, TlsChannel]]:
    with ThreadPoolExecutor(1) as thread:
        one, other = socket.socketpair()
        with one, other:
            near, far = TlsChannel(one, lambda: None, accepts=True), TlsChannel(other, lambda: None, accepts=False)
            shown = thread.submit(near.shake_hands)
            assert far.shake_hands() == shown.result(PATIENCE) != b""
            yield near, far


def send_all(channel: TlsChannel, said: list[bytes], flags: int) -> None:
    buffers = [memoryview(one) for one in said if one]
    while buffers:
        try:
            count = channel.send(buffers, None, flags)
        except BlockingIOError:
            flags = 0
            continue
        buffers = unsent(buffers, count)


def receive_all(channel: TlsChannel, nbytes: int) -> bytes:
    wanted = memoryview(bytearray(nbytes))
    count = 0
    while count < nbytes:
        count += channel.receive_into(wanted[count:])
    return bytes(wanted)


def test_links_between_machines_are_encrypted_and_those_of_one_are_not() -> None:
    token = new_token()
    for host in filter(None, (LOOPBACK, BESIDE, of_machine())):
        with Listener(Role.CLIENT, token, host=host) as listener:
            with dialled(listener.address, token, Encryption.BETWEEN_MACHINES) as far:
                assert bool(far.binding) == (host == of_machine())


@pytest.mark.parametrize("near", Encryption)
@pytest.mark.parametrize("far", Encryption)
def test_encryption_on_one_side_alone_lets_nobody_in(near: Encryption, far: Encryption) -> None:
    token = new_token()
    with listening(token, near) as listener:
        if (near is Encryption.ALWAYS) == (far is Encryption.ALWAYS):
            dialled(listener.address, token, far).close()
        else:
            with pytest.raises(VolsplatError, match="--tls or --no-tls on both sides or on neither"):
                dialled(listener.address, token, far)


def test_another_token_is_refused_over_tls() -> None:
    with listening(new_token(), Encryption.ALWAYS) as listener:
        with pytest.raises(BadInput, match="another session token"):
            dialled(listener.address, new_token(), Encryption.ALWAYS)


def test_versions_before_1_3_are_refused() -> None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    with listening(new_token(), Encryption.ALWAYS) as listener:
        with socket.create_connection(listener.address, timeout=PATIENCE) as caller, pytest.raises(ssl.SSLError):
            context.wrap_socket(caller)


def test_a_relay_that_ends_the_tls_itself_is_noticed() -> None:
    """It has the bytes of both sides in the clear, and passes them on as they are."""
    token = new_token()
    with listening(token, Encryption.ALWAYS) as listener, Relay(listener.address) as relay:
        with pytest.raises(BadInput, match="another session token"):
            dialled(relay.address, token, Encryption.ALWAYS)
        assert relay.read_along > 0
        assert listener.accept(0) is None


@pytest.mark.parametrize("sent", [b"", b"\x16\x03\x01", b"\x16\x03\x01\x40\x00" + bytes(100)])
def test_a_caller_who_does_not_finish_the_tls_handshake_is_dropped_in_time(sent: bytes) -> None:
    with listening(new_token(), Encryption.ALWAYS, 0.5) as listener:
        with socket.create_connection(listener.address, timeout=PATIENCE) as caller:
            caller.sendall(sent)
            with suppress(ConnectionResetError):
                while caller.recv(4096):  # an alert
                    pass


def test_a_stranger_cannot_have_an_endless_tls_handshake_read() -> None:
    with listening(new_token(), Encryption.ALWAYS) as listener:
        with socket.create_connection(listener.address, timeout=PATIENCE) as caller:
            with pytest.raises(OSError):
                while True:
                    caller.sendall(b"\x16\x03\x01\x00\x04\x01\xff\xff\xff" + bytes(1 << 16))


class Relay:
    """Ends the TLS of a caller with a certificate of its own, and begins another with the listener."""

    def __init__(self, behind: Address) -> None:
        self._behind = behind
        self._port = socket.create_server((BESIDE, 0))
        self.address = Address(*self._port.getsockname()[:2])
        self.read_along = 0
        self._ends = ExitStack()  # closes the sockets
        self._ends.enter_context(self._port)
        self._threads = [threading.Thread(target=self._take, daemon=True)]

    def __enter__(self) -> "Relay":
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        for thread in self._threads:
            thread.join(PATIENCE)
        self._ends.close()

    def _take(self) -> None:
        caller, _ = self._port.accept()
        accepting_context.cache_clear()  # as a process of its own has another certificate
        near = TlsChannel(caller, lambda: None, accepts=True)
        accepting_context.cache_clear()  # before the listener makes one
        behind = socket.create_connection(self._behind)
        self._ends.enter_context(caller)
        self._ends.enter_context(behind)
        far = TlsChannel(behind, lambda: None, accepts=False)
        near.shake_hands()
        far.shake_hands()
        for here, there, end in ((near, far, behind), (far, near, caller)):
            self._threads.append(threading.Thread(target=self._pass_on, args=(here, there, end), daemon=True))
            self._threads[-1].start()

    def _pass_on(self, here: TlsChannel, there: TlsChannel, end: socket.socket) -> None:
        piece = memoryview(bytearray(1 << 16))
        with suppress(OSError):
            while count := here.receive_into(piece):
                self.read_along += count
                there.send([piece[:count]], None, 0)
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def test_who_has_no_room_for_a_temporary_file_is_told_the_cure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Not that the caller is gone."""
    token = new_token()
    accepting_context.cache_clear()
    with monkeypatch.context() as patched, listening(token, Encryption.ALWAYS) as listener:
        patched.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
        with pytest.raises(VolsplatError):
            dialled(listener.address, token, Encryption.ALWAYS)
        told = "TLS needs a temporary file: No such file or directory; set TMPDIR to a folder"
        wait_until(lambda: told in caplog.text, "told")
