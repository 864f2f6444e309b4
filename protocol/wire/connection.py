"""One authenticated connection: the protocol over a blocking stdlib socket. Knows nothing of who dialled whom.

One thread receives, any threads send. Back-pressure is the socket's: a peer that does not read makes send() wait.
"""

import errno
import os
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.exchanges import EXCHANGES, Exchanges
from volsplat.protocol.messages.messages import Message
from volsplat.protocol.messages.roles import Role, Way
from volsplat.protocol.messages.session_messages import Alive
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.text.errors import LocalProtocolError, PeerLost, RemoteProtocolError, VolsplatError
from volsplat.protocol.wire.addresses import plain_host
from volsplat.protocol.wire.channel import Channel, PlainChannel, unsent
from volsplat.protocol.wire.descriptors import ReceivedDescriptors
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.framing import Allocate, Decoder, Received, encode, new_buffer
from volsplat.protocol.wire.peer import Counters, Peer
from volsplat.protocol.wire.signs_of_life import LeaveSigns, SignsOfLife
from volsplat.protocol.wire.socket_options import lose_after, set_options
from volsplat.protocol.wire.tcp_info import Delivery, delivery, round_trip
from volsplat.protocol.wire.tls_channel import TlsChannel

if TYPE_CHECKING:
    from typing_extensions import Buffer

OWN_OUTPUT = "its own output tells why"  # of a peer that is gone
PATH_CURE = "check the network between, and whether it lets packets of full size through (MTU)"
MOST_BUFFERS = 512  # in one sendmsg; below every system's IOV_MAX
SHORT_MESSAGE = 4096  # bytes; a third of the smallest send buffer holds it


class ConnectionClosed(VolsplatError):
    """This side has closed the connection."""


class Connection:
    """Sends and receives messages over a connected socket, which it owns.

    A new one is in the handshake (see dialling and listener); open() ends that.
    """

    def __init__(self, connected: socket.socket, place: str) -> None:
        """`place` names the other end in errors until open() tells who is there."""
        self._socket = connected
        self._place = place
        self._peer: Peer | None = None
        self.id = 0  # ours in the session, 0 for the client
        self.counters = Counters()
        self.peers_silence = 0.0  # seconds after which the other end takes silence for a loss, once it has said so
        self._decoder = Decoder()
        self.descriptors = ReceivedDescriptors()  # the receiving thread's
        self._channel: Channel = PlainChannel(connected, self.descriptors)
        self.binding = b""  # what proofs are bound to: the fingerprint of the accepter's certificate
        self._outgoing = Speech()
        self._deadline: float | None = None
        self._sending = threading.Lock()  # guards the outgoing stream: one message at a time
        self._leave: Callable[[], SignsOfLife | None] | None = None  # has signs of life follow what is sent; guarded
        self._signs: SignsOfLife | None = None  # those that follow now
        self._gate = threading.Lock()  # guards _closed and _users
        self._closed = False
        self._loss = ""  # why, where it was not this side that wished it
        self._broken = False  # the other end broke the protocol
        self._users = 0  # calls that are inside the socket; the last one out of a closed connection frees it
        with suppress(OSError):  # macOS sets none where the peer has gone already; receive() will tell
            set_options(connected)

    @property
    def peer(self) -> Peer:
        assert self._peer is not None, "the handshake is not over"
        return self._peer

    @property
    def opened(self) -> bool:
        """True once the handshake is over."""
        return self._peer is not None

    @property
    def closed(self) -> bool:
        return self._closed

    @property
    def loss(self) -> str:
        """Why it was closed, unless this side wished it."""
        return self._loss

    @property
    def broken(self) -> bool:
        """Whether it was closed since the other end broke the protocol, which `loss` tells then."""
        return bool(self._loss) and self._broken

    @property
    def may_share_memory(self) -> bool:
        """Whether the other end is a process of this user on this machine, which descriptors can be passed to."""
        return self._socket.family == socket.AF_UNIX

    @property
    def local_host(self) -> str:
        """The address of this side, as the other one reaches it; "" by a Unix socket, or once it is closed."""
        if self.may_share_memory:
            return ""
        try:
            return plain_host(self._socket.getsockname()[0])
        except OSError:
            return ""

    @property
    def round_trip(self) -> float:
        """Seconds that a word and its answer take at least, as far as the system has measured them."""
        with suppress(OSError):  # it is closed
            return round_trip(self._socket)
        return 0.0

    @property
    def delivery(self) -> Delivery:
        """How what was sent fares."""
        with suppress(OSError):  # it is closed
            return delivery(self._socket)
        return Delivery(False, 0)

    def __str__(self) -> str:
        return str(self._peer) if self._peer is not None else self._place

    def open(self, peer: Peer, own_role: Role, own_id: int, allocate: Allocate = new_buffer) -> None:
        """The handshake is over: `peer` is who it says it is. Lifts the deadline and the handshake's limits.

        Raises ConnectionClosed where this side has closed it meanwhile.
        """
        there, back = Way(own_role, peer.role), Way(peer.role, own_role)
        exchanges = next((Exchanges(way) for way in (there, back) if way in EXCHANGES), None)
        incoming = Speech(back, server=peer.id if peer.role == Role.DATA_LINK else 0, exchanges=exchanges)
        with self._inside():
            self._decoder = Decoder(incoming, allocate)
            self._outgoing = Speech(there, exchanges=exchanges)
            self._peer, self.id = peer, own_id
            self._deadline = None
            self._socket.settimeout(None)

    def limit(self, seconds: float) -> None:
        """From now until open(), sends and receives fail with PeerLost once this much time has passed."""
        self._deadline = time.monotonic() + seconds

    def encrypt(self, encryption: Encryption, *, accepts: bool) -> None:
        """Speak TLS from now on if this link is to be encrypted; `accepts`: this side was dialled. Raises BadInput."""
        try:
            with self._inside():
                if encryption.holds_for(self._socket):
                    channel = TlsChannel(self._socket, self._keep_deadline, accepts=accepts)
                    self.binding = channel.shake_hands()
                    self._channel = channel
        except OSError as error:
            raise self._lost(error) from error

    def lose_after(self, seconds: float) -> None:
        """From now on, a peer that has not taken what was sent for so long is gone: for one that always reads.

        It must never stop reading on purpose: Linux counts that as silence, though the peer's machine answers.
        """
        with suppress(OSError):  # it is closed already
            lose_after(self._socket, seconds)

    def send(self, message: Message, *payload: "Buffer", descriptor: int | None = None) -> None:
        """Send a message and its payload, whose memory is free again on return. Any thread may call it.

        `descriptor` is that of the memory that it brings, which the other end gets a descriptor of its own for.
        Raises PeerLost, ConnectionClosed, or LocalProtocolError for what the rules forbid.
        """
        with self._sending:
            self._send(message, payload, descriptor)

    def send_at_once(self, message: Message) -> bool:
        """Send a message without payload if that goes without waiting; returns whether it was sent. See send().

        It waits for nobody if it is short, nothing else is being sent, and the peer has read most of what went before.
        """
        if not self._sending.acquire(blocking=False):
            return False
        try:
            if len(encode_control(message)) > SHORT_MESSAGE or not self.has_room:
                return False
            self._send(message, (), None)
            return True
        finally:
            self._sending.release()

    def say_alive(self, silence: float) -> None:
        """Say that this side is there, and after which silence it gives the peer up, if that goes without waiting.

        Nothing is said while something is being sent, nor after the end of the session. What is lost, receive() tells.
        """
        with suppress(PeerLost, ConnectionClosed, LocalProtocolError):
            self.send_at_once(Alive(silence))

    def leave_signs(self, silence: float, leave: LeaveSigns) -> None:
        """From now on have signs of life given from outside of the interpreter. Waits, and raises, as send() does."""

        def ready() -> bytes:
            return self._channel.sealed(encode(Alive(silence), speech=self._outgoing))

        with self._sending:
            self._leave = lambda: leave(self._socket.fileno(), ready)
            self._send(Alive(silence), (), None)

    def leave_no_signs(self) -> None:
        """From now on only the interpreter's own words are signs of life. Waits, and raises, as send() does."""
        with self._sending, self._inside():
            self._leave = None
            self._send_signs()

    @property
    def signs_left(self) -> int:
        """How many signs of life are still to be given from outside of the interpreter."""
        signs = self._signs
        return signs.left if signs is not None else 0

    @property
    def has_room(self) -> bool:
        """Whether a short message would leave at once."""
        return self._ready(select.POLLOUT)

    @property
    def unread(self) -> bool:
        """Whether something has come that receive() has not taken yet."""
        return not self._closed and (self._channel.holds_unread or self._ready(select.POLLIN))

    @property
    def hung_up(self) -> bool:
        """Whether the other side has ended what it sends, though receive() may not have come to that yet."""
        return self._ready(select.POLLRDHUP)

    @property
    def came(self) -> int:
        """Bytes that have come, of messages and of what carries them, though there may be no whole message yet."""
        return self._channel.came

    def receive(self) -> Received | None:
        """The next message, or None once this side has called close(). One thread only.

        Raises PeerLost where the stream ends or fails, RemoteProtocolError where it breaks the protocol; the
        connection is closed then.
        """
        try:
            return self._next_message()
        except ConnectionClosed:
            return None
        except RemoteProtocolError as error:
            loss = f"{self} broke the protocol: {error}"
            self._closed_for(loss, broken=True)
            raise RemoteProtocolError(loss) from error
        except OSError as error:
            lost = self._lost(error)
            if isinstance(lost, ConnectionClosed):
                return None
            raise lost from error

    def _next_message(self) -> Received:
        """It, once it is whole. If it never is, a descriptor that has come for it is closed."""
        began = 0.0
        try:
            with self._inside():
                while True:
                    self._keep_deadline()
                    count = self._channel.receive_into(self._decoder.wanted())
                    if count == 0:
                        raise self._ended()
                    began = began or time.perf_counter()
                    self.counters.bytes_in += count
                    received = self._decoder.advance(count)
                    if received is not None and isinstance(received.message, Alive):
                        self.peers_silence = received.message.silence
                        began = 0.0
                    elif received is not None:
                        self.counters.messages_in += 1
                        self.descriptors.come(received.message)
                        self.counters.seconds_in_message = time.perf_counter() - began
                        return received
        except BaseException:
            self.descriptors.close()
            raise

    def give_up(self, loss: str) -> None:
        """Close it since the peer is lost: `loss` says so, and is what receive() and send() raise."""
        self._closed_for(loss)

    def give_up_sending(self) -> None:
        """Likewise, since the network swallows what is sent, though the peer is heard."""
        self._closed_for(self._untaken)

    def close(self) -> None:
        """Close both directions and wake whoever is blocked in send() or receive(). May be called again."""
        with self._gate:
            if self._closed:
                return
            self._closed = True
            with suppress(OSError):  # the peer may have been faster
                self._socket.shutdown(socket.SHUT_RDWR)
            if self._users == 0:
                self._socket.close()

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _inside(self) -> Iterator[None]:
        # A socket must not be freed under a blocked call: its number could be another connection's by then.
        with self._gate:
            if self._closed:
                raise self._why_closed()
            self._users += 1
        try:
            yield
        finally:
            with self._gate:
                self._users -= 1
                if self._closed and self._users == 0:
                    self._socket.close()

    def _send(self, message: Message, payload: "tuple[Buffer, ...]", descriptor: int | None) -> None:
        with self._inside():
            buffers = encode(message, *payload, speech=self._outgoing)
            self._send_signs()
            with self._whole():
                self._send_all(buffers, descriptor)
            if self._leave is not None:
                self._signs = self._leave()
        if not isinstance(message, Alive):
            self.counters.messages_out += 1

    def _send_signs(self) -> None:
        """Those that were left: encrypted ones have their place in the stream."""
        if self._signs is not None:
            signs, self._signs = memoryview(self._signs.take_back()), None
            with self._whole():
                while signs:
                    self._keep_deadline()
                    signs = signs[self._socket.send(signs) :]

    @contextmanager
    def _whole(self) -> Iterator[None]:
        """What is sent within is sent whole, or the connection is lost."""
        try:
            yield
        except OSError as error:
            raise self._lost(error) from error
        except BaseException:  # half a message has gone out: the stream has no more meaning
            self.close()
            raise

    def _ready(self, event: int) -> bool:
        with suppress(ConnectionClosed, PeerLost), self._inside():
            poll = select.poll()
            poll.register(self._socket, event)
            return bool(poll.poll(0))
        return False

    def _send_all(self, buffers: list[memoryview], descriptor: int | None) -> None:
        self._keep_deadline()
        blocked_since = None
        flags: int = socket.MSG_DONTWAIT  # the first try, so that only time spent blocked is counted
        while buffers:
            try:
                count = self._channel.send(buffers[:MOST_BUFFERS], descriptor, flags)
            except BlockingIOError as error:
                if not flags:  # it was waited for, as long as lose_after() has it
                    raise TimeoutError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT)) from error
                count = 0
            descriptor = None if count else descriptor
            self.counters.bytes_out += count
            buffers = unsent(buffers, count)
            if buffers and flags:
                flags, blocked_since = 0, time.perf_counter()
        if blocked_since is not None:
            self.counters.seconds_in_send += time.perf_counter() - blocked_since

    def _keep_deadline(self) -> None:
        if self._deadline is not None:
            left = self._deadline - time.monotonic()
            if left <= 0:
                raise TimeoutError
            self._socket.settimeout(left)

    def _ended(self) -> VolsplatError:
        place = "" if self._decoder.between_messages else " in the middle of a message"
        return self._closed_for(f"{self} is gone: it closed the connection{place}{self._who_tells}")

    def _lost(self, error: OSError) -> VolsplatError:
        if isinstance(error, TimeoutError) and self._deadline is not None:
            return self._closed_for(f"{self} did not finish the handshake in time")
        if error.errno == errno.ETIMEDOUT:
            return self._closed_for(self._untaken)
        return self._closed_for(f"{self} is gone: {error.strerror or error}{self._who_tells}")

    @property
    def _untaken(self) -> str:
        return f"{self} is gone: what is sent to it does not arrive, or is not taken; {PATH_CURE}"

    @property
    def _who_tells(self) -> str:
        """Who has never said anything may be no program of ours."""
        return f"; {OWN_OUTPUT}" if self.opened or self.counters.messages_in else ""

    def _closed_for(self, loss: str, *, broken: bool = False) -> VolsplatError:
        """Close it for this loss, and say why it is closed: whichever thread finds a loss first, both tell that one."""
        with self._gate:
            if not (self._closed or self._loss):
                self._broken = broken  # before the loss: whoever sees that knows whether it is so
                self._loss = loss
        self.close()
        return self._why_closed()

    def _why_closed(self) -> VolsplatError:
        return PeerLost(self._loss) if self._loss else ConnectionClosed(f"the connection to {self} is closed")
