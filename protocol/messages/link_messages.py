"""Messages that measure a link: how long bytes take there and back."""

from typing import Annotated, ClassVar

from msgspec import Meta

from volsplat.protocol.messages.message import Message, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT

LARGEST_MEASURE = 1 << 22  # bytes

LinkBytes = Annotated[int, Meta(ge=0, le=LARGEST_MEASURE)]


class LinkMeasured(Message, frozen=True):
    """Map/shade server or splat server to client: as many bytes as were wanted, of any value."""

    largest_payload: ClassVar[int] = LARGEST_MEASURE

    bytes: LinkBytes

    def payload_bytes(self) -> int:
        return self.bytes


@asks(CLIENT_TO_MAPSHADE, LinkMeasured)
@asks(CLIENT_TO_SPLAT, LinkMeasured)
class MeasureLink(Message, frozen=True):
    """Client to map/shade server and splat server: here are bytes of any value; answer at once, with so many.

    Asked by `volsplat deploy doctor`, never in a session that draws.
    """

    largest_payload: ClassVar[int] = LARGEST_MEASURE

    sent: LinkBytes
    wanted: LinkBytes

    def payload_bytes(self) -> int:
        return self.sent
