"""What may be said in one direction of a connection, by what the messages declare.

It knows nothing of bytes on the wire (see framing) nor of the handshake's order (see handshake).
"""

from volsplat.protocol.messages.exchanges import Exchanges
from volsplat.protocol.messages.frame_messages import Batch
from volsplat.protocol.messages.greetings import Greeting
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Way


class Speech:
    """What may be said in one direction of a connection, from now on. Sender and receiver each keep one."""

    def __init__(self, way: Way | None = None, server: int = 0, exchanges: Exchanges | None = None) -> None:
        """`way` is None during the handshake. `server`, if not 0: the only worker that batches may name.

        `exchanges` are those of the connection, shared by both directions; None on a data link, where nobody asks.
        """
        self.way = way
        self.server = server
        self._exchanges = exchanges
        self._ended = False  # EndSession was sent this way

    @property
    def greeting(self) -> bool:
        """Whether the handshake is not over."""
        return self.way is None

    def payload_bytes(self, message: Message) -> int:
        """The length that the message announces. Raises ValueError if it is out of place or announces too much."""
        name = type(message).__name__
        if self._ended:
            raise ValueError(f"{name} came after the session had ended")
        if self.greeting != isinstance(message, Greeting):
            raise ValueError(f"{name} came {'during' if self.greeting else 'after'} the handshake")
        if self.way is not None and self.way not in message.ways:
            raise ValueError(f"{name} came from {self.way}, but it goes from {' or '.join(map(str, message.ways))}")
        if isinstance(message, Batch) and self.server not in (0, message.worker):
            raise ValueError(f"Batch.worker is {message.worker}, but this data link is of worker {self.server}")
        if self._exchanges is not None:
            self._exchanges.check(message)
        announced = message.payload_bytes()
        if announced > message.largest_payload:
            raise ValueError(f"{name} announces {announced} bytes, but its limit is {message.largest_payload}")
        return announced

    def said(self, message: Message) -> None:
        """The message is over: move on."""
        if self._exchanges is not None:
            self._exchanges.said(message)
        self._ended = self._ended or message.ends
