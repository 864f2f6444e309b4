"""The control part of a message: the message itself as msgpack."""

import re
from typing import Union

import msgspec

from volsplat.protocol.messages.greetings import GREETINGS
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.text.errors import LocalProtocolError, RemoteProtocolError
from volsplat.protocol.text.printable import printable

_ENCODER = msgspec.msgpack.Encoder()
_GREETING_DECODER = msgspec.msgpack.Decoder(Union[GREETINGS])  # noqa: UP007
_DECODER = msgspec.msgpack.Decoder(Union[MESSAGES])  # noqa: UP007

# Of one version of the protocol, between two releases.
OTHER_BUILD = "; if it is another build of volsplat, install the same one on all machines"


def encode_control(message: Message) -> bytes:
    """The message as msgpack. Raises LocalProtocolError for a field that msgpack cannot carry."""
    try:
        return _ENCODER.encode(message)
    except (TypeError, ValueError, OverflowError) as error:
        raise LocalProtocolError(f"{type(message).__name__} cannot be sent: {error}") from error


def decode_control(control: bytes | bytearray | memoryview, greeting: bool = False) -> Message:
    """The message that `control` holds: one of the handshake's if it is a `greeting`, else one of an open connection.

    Raises RemoteProtocolError naming the field, its value and its limit.
    """
    try:
        message: Message = (_GREETING_DECODER if greeting else _DECODER).decode(control)
        return message
    except (msgspec.DecodeError, ValueError, ArithmeticError, RecursionError) as error:
        cure = OTHER_BUILD if isinstance(error, msgspec.ValidationError) else ""
        raise RemoteProtocolError(f"the control part cannot be read: {_in_one_line(error, control)}{cure}") from error


def _in_one_line(error: Exception, control: bytes | bytearray | memoryview) -> str:
    """The error in one line, with the offending value where msgspec gives its place."""
    text = printable(" ".join(str(error).split()))
    place = re.search(r" - at `\$((?:\.\w+|\[\d+\])+)`$", text)
    if place is None:
        return text
    try:
        value = msgspec.msgpack.decode(control)
        for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place[1]):
            value = value[key] if key else value[int(index)]
    except (msgspec.DecodeError, ValueError, LookupError, TypeError, RecursionError):
        return text
    return f"{text}, which is {ascii(value)[:80]}"
