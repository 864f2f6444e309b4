"""TLS 1.3 over a connected socket, so that one thread may receive while another sends.

An SSLSocket is for one thread. Here the TLS itself is done in memory, under a lock that is held for no longer than a
piece takes; the socket is read and written outside of it.
"""

import errno
import socket
import ssl
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.certificates import accepting_context, dialling_context, fingerprint

if TYPE_CHECKING:
    from typing_extensions import Buffer

PIECE = 256 << 10  # bytes that are encrypted or decrypted at a time
RECORD = 16 << 10  # the most that one record of TLS holds; smaller buffers are joined up to it
MOST_HANDSHAKE_BYTES = 32 << 10  # that a stranger may send; TLS 1.3 with one small certificate takes less than 4 KiB
HANDSHAKE_RECORD = 22  # the first byte of whoever begins with TLS
ONE_SIDED = "TLS is asked for by one side alone; give --tls or --no-tls on both sides or on neither"


class PlainCaller(BadInput):
    """It speaks plainly where TLS is asked for."""


class TlsChannel:
    def __init__(self, connected: socket.socket, keep_deadline: Callable[[], None], *, accepts: bool) -> None:
        """`accepts`: this side was dialled. Call shake_hands() before all else.

        `keep_deadline` is called before each wait, and raises TimeoutError where there is no time left.
        """
        self._socket = connected
        self._keep_deadline = keep_deadline
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        context, self._shown = accepting_context() if accepts else (dialling_context(), b"")
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=accepts)
        self._lock = threading.Lock()  # guards the three above
        self._raw = memoryview(bytearray(PIECE))  # the receiving thread's
        self._waits = False  # the receiving thread, for the socket: all that is here is the beginning of a record
        self.came = 0
        self._unsent = memoryview(b"")  # encrypted, the sending thread's
        self._taken = 0  # bytes of the caller's that are in it

    def shake_hands(self) -> bytes:
        """Raises BadInput where the other end does not speak TLS 1.3; else the accepter's fingerprint."""
        came = 0
        try:
            while not self._shaken():
                self._flush()
                count = self._receive_raw()
                if count == 0:
                    why = "" if came else f"; if it gives no other reason: {ONE_SIDED}"  # what came was TLS
                    raise ConnectionResetError(errno.ECONNRESET, f"it ended the TLS handshake{why}")
                if came == 0 and self._raw[0] != HANDSHAKE_RECORD:
                    raise PlainCaller(f"it does not speak TLS: {ONE_SIDED}")
                came += count
                if came > MOST_HANDSHAKE_BYTES:
                    raise BadInput(f"its TLS handshake takes more than {MOST_HANDSHAKE_BYTES} bytes")
                self._incoming.write(self._raw[:count])
        except ssl.SSLError as error:
            with suppress(OSError):
                self._flush()  # the alert, which tells the other end
            raise BadInput(f"TLS 1.3 fails with it: {_reason(error)}") from error
        self._flush()
        if self._shown:
            return self._shown
        certificate = self._tls.getpeercert(binary_form=True)
        assert certificate is not None, "TLS 1.3 without a certificate of the accepter's"
        return fingerprint(certificate)

    def receive_into(self, wanted: memoryview) -> int:
        """As recv_into."""
        wanted = wanted[:PIECE]
        while True:
            with self._lock:
                try:
                    return _read(self._tls, wanted)
                except ssl.SSLWantReadError:
                    self._waits = True
                except ssl.SSLZeroReturnError:
                    return 0
            count = self._receive_raw()
            if count == 0:
                return 0
            with self._lock:
                self._waits = False
                self._incoming.write(self._raw[:count])

    @property
    def holds_unread(self) -> bool:
        with self._lock:
            return not self._waits and bool(self._incoming.pending or self._tls.pending())

    def send(self, buffers: list[memoryview], descriptor: int | None, flags: int) -> int:
        """As Channel has it; what was encrypted goes first."""
        if not self._unsent:
            self._taken, encrypted = self._encrypted(_first_piece(buffers))
            self._unsent = memoryview(encrypted)
        while self._unsent:
            self._keep_deadline()
            self._unsent = self._unsent[self._socket.send(self._unsent, flags) :]
        return self._taken

    def sealed(self, buffers: list[memoryview]) -> bytes:
        assert not self._unsent, "what was encrypted goes first"
        return self._encrypted(b"".join(buffers))[1]

    def _encrypted(self, piece: "Buffer") -> tuple[int, bytes]:
        """How much of it is encrypted, and the bytes of that."""
        with self._lock:
            return self._tls.write(piece), self._outgoing.read()

    def _shaken(self) -> bool:
        try:
            self._tls.do_handshake()
        except ssl.SSLWantReadError:
            return False
        return True

    def _receive_raw(self) -> int:
        self._keep_deadline()
        count = self._socket.recv_into(self._raw)
        self.came += count
        return count

    def _flush(self) -> None:
        if self._outgoing.pending:
            self._socket.sendall(self._outgoing.read())


def _read(tls: ssl.SSLObject, wanted: memoryview) -> int:
    count: Any = tls.read(len(wanted), wanted)  # typeshed takes it for bytes
    return int(count)


def _first_piece(buffers: list[memoryview]) -> memoryview:
    """What is encrypted next: a piece of a large buffer, or small ones joined."""
    if len(buffers) == 1 or len(buffers[0]) >= RECORD:
        return buffers[0][:PIECE]
    joined = bytearray()
    for buffer in buffers:
        joined += buffer[: RECORD - len(joined)]
        if len(joined) == RECORD:
            break
    return memoryview(joined)


def _reason(error: ssl.SSLError) -> str:
    return (error.reason or "it broke the handshake off").lower().replace("_", " ")
