"""Messages as bytes: a 16-byte header, the control part (msgpack), the payload. Bytes in, messages out; no socket.

Header, little endian:

    bytes 0.. 3  magic, "VSPL"
    bytes 4.. 7  uint32, length of the control part
    bytes 8..15  uint64, length of the payload
"""

import struct
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from volsplat.protocol.messages.control_part import decode_control, encode_control
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.text.errors import LocalProtocolError, RemoteProtocolError

if TYPE_CHECKING:
    from typing_extensions import Buffer

HEADER = struct.Struct("<IIQ")
MAGIC = int.from_bytes(b"VSPL", "little")
TLS_BEGINS = b"\x16\x03"  # a TLS handshake
LARGEST_CONTROL = 1 << 20
LARGEST_PAYLOAD = max(kind.largest_payload for kind in MESSAGES)
LARGEST_GREETING = 4096  # control part of a peer that has not proved itself; it may send no payload

# Gives the memory that a payload of so many bytes is received into: at least as long, contiguous, writable.
Allocate = Callable[[Message, int], "Buffer"]


class Received(NamedTuple):
    """A message and its payload: the memory that was allocated for it, cut to its length."""

    message: Message
    payload: memoryview


class _Section(Enum):
    HEADER = "header"
    CONTROL = "control part"
    PAYLOAD = "payload"


def new_buffer(message: Message, nbytes: int) -> bytearray:
    """The plainest Allocate: fresh memory for each payload."""
    return bytearray(nbytes)


class Decoder:
    """Turns one direction's bytes into messages without copying payloads.

    The caller writes bytes to the start of `wanted()` and says how many with `advance()`, which returns a message
    once it is whole and None while more bytes are needed. Nothing is allocated before its length has passed all
    limits. After a RemoteProtocolError the stream has no more meaning: every further call raises it again.
    """

    def __init__(self, speech: Speech | None = None, allocate: Allocate = new_buffer) -> None:
        self._speech = Speech() if speech is None else speech
        self._allocate = allocate
        self._header = memoryview(bytearray(HEADER.size))
        self._control = memoryview(bytearray(LARGEST_GREETING))
        self._message: Message | None = None
        self._payload_bytes = 0
        self._broken: str | None = None
        self._expect(_Section.HEADER, self._header)

    @property
    def between_messages(self) -> bool:
        """True where the stream may end: no message has begun."""
        return self._section == _Section.HEADER and self._filled == 0

    def wanted(self) -> memoryview:
        """Where the next bytes go, never empty."""
        self._check_sound()
        return self._target[self._filled :]

    def advance(self, nbytes: int) -> Received | None:
        """Take note of `nbytes` bytes in `wanted()`. Raises RemoteProtocolError naming field, value and limit."""
        self._check_sound()
        if not 0 < nbytes <= len(self._target) - self._filled:
            raise LocalProtocolError(f"advance by {nbytes} bytes, but {len(self._target) - self._filled} are wanted")
        self._filled += nbytes
        if self._filled < len(self._target):
            return None
        try:
            return self._section_filled()
        except RemoteProtocolError as error:
            self._broken = str(error)
            raise

    def _check_sound(self) -> None:
        if self._broken is not None:
            raise RemoteProtocolError(self._broken)

    def _expect(self, section: _Section, target: memoryview) -> None:
        self._section, self._target, self._filled = section, target, 0

    def _section_filled(self) -> Received | None:
        if self._section == _Section.HEADER:
            self._header_filled()
            return None
        if self._section == _Section.CONTROL:
            return self._control_filled()
        return self._whole(self._target)

    def _header_filled(self) -> None:
        magic, control_bytes, payload_bytes = HEADER.unpack(self._header)
        greeting = self._speech.greeting
        largest_control = LARGEST_GREETING if greeting else LARGEST_CONTROL
        largest_payload = 0 if greeting else LARGEST_PAYLOAD
        if magic != MAGIC:
            tls = "; this is TLS, which this side does not expect" if self._header[:2] == TLS_BEGINS else ""
            raise RemoteProtocolError(f"magic is 0x{magic:08x}, but volsplat's is 0x{MAGIC:08x}{tls}")
        if not 0 < control_bytes <= largest_control:
            raise RemoteProtocolError(f"control_bytes is {control_bytes}, but 1 to {largest_control} are allowed")
        if payload_bytes > largest_payload:
            raise RemoteProtocolError(f"payload_bytes is {payload_bytes}, but at most {largest_payload} are allowed")
        if control_bytes > len(self._control):
            self._control = memoryview(bytearray(control_bytes))
        self._payload_bytes = payload_bytes
        self._expect(_Section.CONTROL, self._control[:control_bytes])

    def _control_filled(self) -> Received | None:
        message = decode_control(self._target, self._speech.greeting)
        try:
            announced = self._speech.payload_bytes(message)
        except ValueError as error:
            raise RemoteProtocolError(str(error)) from error
        if self._payload_bytes != announced:
            raise RemoteProtocolError(
                f"payload_bytes is {self._payload_bytes}, but {type(message).__name__} announces {announced}"
            )
        self._message = message
        if announced == 0:
            return self._whole(memoryview(b""))
        memory = memoryview(self._allocate(message, announced)).cast("B")
        if memory.readonly or len(memory) < announced:
            raise LocalProtocolError(f"allocate must give {announced} writable bytes, but gave {len(memory)}")
        self._expect(_Section.PAYLOAD, memory[:announced])
        return None

    def _whole(self, payload: memoryview) -> Received:
        assert self._message is not None
        received = Received(self._message, payload)
        self._speech.said(received.message)
        self._message = None
        self._expect(_Section.HEADER, self._header)
        return received


def encode(message: Message, *payload: "Buffer", speech: Speech | None = None) -> list[memoryview]:
    """The buffers to send, in order: header and control part in one, then the payload's own memory, not copied.

    Raises LocalProtocolError where the message may not be said now or the payload is not what it announces.
    """
    speech = Speech() if speech is None else speech
    control = encode_control(message)
    parts = [memoryview(part) for part in payload]
    payload_bytes = sum(part.nbytes for part in parts)
    name = type(message).__name__
    try:
        announced = speech.payload_bytes(message)
    except ValueError as error:
        raise LocalProtocolError(str(error)) from error
    if payload_bytes != announced:
        raise LocalProtocolError(f"the payload has {payload_bytes} bytes, but {name} announces {announced}")
    largest = LARGEST_GREETING if speech.greeting else LARGEST_CONTROL
    if len(control) > largest:
        raise LocalProtocolError(f"{name} has {len(control)} bytes of control, but its limit is {largest}")
    speech.said(message)
    head = memoryview(HEADER.pack(MAGIC, len(control), payload_bytes) + control)
    return [head, *(part.cast("B") for part in parts if part.nbytes)]
