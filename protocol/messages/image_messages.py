"""Messages about the image: how it comes to the client, and what the client says of how it came."""

from typing import Annotated, ClassVar

import msgspec
from msgspec import Meta

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.messages.message import (
    MAX_SERVERS,
    BlockCount,
    BlockNumber,
    Count,
    Detail,
    FrameId,
    Message,
    Ordinal,
    Seconds,
    asks,
    says,
)
from volsplat.protocol.messages.roles import CLIENT_TO_SPLAT
from volsplat.protocol.rules.regions import LineNumber

RGBA_BYTES = 16  # four float32


class RawPixels(Detail, frozen=True, tag=True):
    """The payload is (height, width, 4) float32, RGBA 0..1, alpha associated, top row first."""


class CodedPixels(Detail, frozen=True, tag=True):
    """The payload has so many bytes: the tiles that have changed, compressed (see image_tiles).

    They have changed since the image before, which had the same rectangle and was as `exact`, or, if this image does
    not `follow` one, since an image of zeros. Coding took `coding_seconds`.
    """

    exact: bool  # bit for bit; else 8 bits a channel
    follows: bool
    bytes: Count
    coding_seconds: Seconds


class SharedPixels(Detail, frozen=True, tag=True):
    """They lie in a block of memory that both sides see, as in the payload of RawPixels; there is no payload.

    With the first image of a memory comes its descriptor: it has so many `blocks` of `block_bytes`, and takes the place
    of the memory before.
    """

    memory: Count
    block: BlockNumber
    blocks: BlockCount
    block_bytes: Count
    first: bool


class ImageRead(Message, frozen=True):
    """Splat server to client: its regions of the published image, from column `left` of row `top` on."""

    largest_payload: ClassVar[int] = LARGEST_EXTENT * LARGEST_EXTENT * RGBA_BYTES

    frame: FrameId
    step: Step
    complete: bool
    left: LineNumber
    top: LineNumber
    width: LineNumber
    height: LineNumber
    pixels: RawPixels | CodedPixels | SharedPixels

    @property
    def exact(self) -> bool:
        """Bit for bit what was drawn."""
        return not isinstance(self.pixels, CodedPixels) or self.pixels.exact

    @property
    def coding_seconds(self) -> float:
        return self.pixels.coding_seconds if isinstance(self.pixels, CodedPixels) else 0.0

    @property
    def raw_bytes(self) -> int:
        return self.width * self.height * RGBA_BYTES

    def carried_by(self, pixels: RawPixels | CodedPixels | SharedPixels) -> "ImageRead":
        return msgspec.structs.replace(self, pixels=pixels)

    @property
    def brings_memory(self) -> bool:
        return isinstance(self.pixels, SharedPixels) and self.pixels.first

    def payload_bytes(self) -> int:
        match self.pixels:
            case RawPixels():
                return self.raw_bytes
            case CodedPixels(bytes=coded) if coded > self.raw_bytes:
                raise ValueError(f"an image of {self.raw_bytes} bytes has been coded as {coded}")
            case CodedPixels(bytes=coded):
                return coded
            case SharedPixels(block_bytes=room) if room < self.raw_bytes:
                raise ValueError(f"an image of {self.raw_bytes} bytes cannot lie in a block of {room}")
        return 0


@asks(CLIENT_TO_SPLAT, ImageRead, at_once=MAX_SERVERS, newest=True)
class ReadImage(Message, frozen=True):
    """Client to splat server: send the image buffer of this frame as it is now, before it is finished."""

    frame: FrameId


@says(CLIENT_TO_SPLAT)
class ImagesTaken(Message, frozen=True):
    """Client to splat server: how images came, from which it chooses how the next ones are to come.

    The newest one with a payload had so many `bytes`, which took `seconds` to arrive and `decoding_seconds` to decode;
    all are 0 if there was none. `freed` are blocks of the shared `memory` that nobody reads any more.
    """

    bytes: Count
    seconds: Seconds
    decoding_seconds: Seconds
    memory: Count
    freed: Annotated[list[Ordinal], Meta(max_length=MAX_SERVERS)]
