"""All messages of an open connection, found by their types."""

from volsplat.protocol.messages import messages
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Role

MESSAGES = tuple(
    kind
    for kind in vars(messages).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
)


def taken_by(receiver: Role) -> frozenset[type[Message]]:
    """What it must have handlers for: what may come once the handshake is over.

    But for what ends the session, and what connections take by themselves.
    """
    handled = (kind for kind in MESSAGES if not (kind.ends or kind.of_connection))
    return frozenset(kind for kind in handled if any(way.receiver is receiver for way in kind.ways))


def _check() -> None:
    """Raises TypeError for a message that does not declare what it must."""
    for kind in MESSAGES:
        if not kind.ways:
            raise TypeError(f"nobody says {kind.__name__}: declare who asks it, who says it, or what it answers")
        if (kind.largest_payload > 0) != (kind.payload_bytes is not Message.payload_bytes):
            raise TypeError(f"{kind.__name__} must declare both largest_payload and payload_bytes, or neither")


_check()
