"""What must hold for any bytes: a message, "more please", or RemoteProtocolError; nothing large is allocated.

The Hypothesis tests and the atheris script both check it.
"""

from collections.abc import Callable

import msgspec

from support.messages.decoded import decoded
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import DIALLED, Role, Way
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.text.errors import BadInput, PeerLost, RemoteProtocolError
from volsplat.protocol.wire.framing import HEADER, LARGEST_CONTROL, Decoder
from volsplat.protocol.wire.handshake import AccepterHandshake, DiallerHandshake, State, new_hello
from volsplat.protocol.wire.tokens import Token

WAYS: tuple[Way | None, ...] = (None, *DIALLED, *(way.back for way in DIALLED))
MOST_ALLOCATED = 1 << 22  # what this harness is ready to give; a lawful image may be larger
TOKEN = Token("the-token-that-the-stranger-does-not-know")


class Declined(Exception):
    """The harness does not give so much memory, although the protocol allows it."""


def outcome(data: bytes, way: Way | None, chunk: int) -> tuple[list[tuple[Message, bytes]], str]:
    """The messages in `data`, fed by `chunk` bytes, and how it ended: an error, or "more" or "end"."""
    heard: list[tuple[Message, bytes]] = []

    def allocate(message: Message, nbytes: int) -> bytearray:
        assert 0 < nbytes <= message.largest_payload, type(message).__name__
        assert nbytes == message.payload_bytes()
        if nbytes > MOST_ALLOCATED:
            raise Declined
        return bytearray(nbytes)

    decoder = Decoder(Speech(way), allocate)
    try:
        for start in range(0, len(data), chunk):
            for received in decoded(decoder, data[start : start + chunk]):
                heard.append((received.message, bytes(received.payload)))
            assert len(decoder.wanted()) <= max(HEADER.size, LARGEST_CONTROL, MOST_ALLOCATED)
    except RemoteProtocolError as error:
        assert "\n" not in str(error)
        return heard, str(error)
    except Declined:
        return heard, "declined"
    return heard, "end" if decoder.between_messages else "more"


def check_stream(data: bytes, way: Way | None) -> list[tuple[Message, bytes]]:
    """The same bytes whole, in pieces and one at a time say the same."""
    whole = _comparable(outcome(data, way, max(len(data), 1)))
    assert _comparable(outcome(data, way, 1)) == whole
    assert _comparable(outcome(data, way, 7)) == whole
    return outcome(data, way, max(len(data), 1))[0]


def _comparable(result: tuple[list[tuple[Message, bytes]], str]) -> tuple[list[tuple[bytes, bytes]], str]:
    # As bytes, since a NaN in a message would not equal itself.
    heard, end = result
    return [(msgspec.msgpack.encode(message), payload) for message, payload in heard], end


def check_handshakes(data: bytes) -> None:
    """A stranger's bytes never open a connection: the handshake waits, rejects or raises."""
    heard = check_stream(data, None)
    check_stranger([message for message, _ in heard])


def check_stranger(said: list[Message]) -> None:
    """The same for messages."""
    accepter = AccepterHandshake(TOKEN, Role.CLIENT)
    dialler = DiallerHandshake(TOKEN, new_hello(Role.MAPSHADE_SERVER), Role.CLIENT)
    dialler.start()
    receivers: tuple[Callable[[Message], object], ...] = (accepter.receive, dialler.receive)
    for receive in receivers:
        for message in said:
            try:
                receive(message)
            except (RemoteProtocolError, BadInput, PeerLost) as error:
                assert "\n" not in str(error)
    assert accepter.state not in (State.PROVEN, State.OPEN)
    assert dialler.state is not State.OPEN
