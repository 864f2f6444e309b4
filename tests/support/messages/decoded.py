"""Bytes that are in memory already, decoded: payloads are copied."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from volsplat.protocol.wire.framing import Decoder, Received

if TYPE_CHECKING:
    from typing_extensions import Buffer


def decoded(decoder: Decoder, data: "Buffer") -> Iterator[Received]:
    """The messages that `data` completes."""
    rest = memoryview(data).cast("B")
    while rest:
        wanted = decoder.wanted()
        count = min(len(wanted), len(rest))
        wanted[:count] = rest[:count]
        rest = rest[count:]
        received = decoder.advance(count)
        if received is not None:
            yield received
