"""The images of one splat server, however they come: in a payload, coded, or in memory that both see."""

import threading
import time

from volsplat.client.session.links.image_decoder import ImageDecoder
from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead, ImagesTaken, RawPixels, SharedPixels
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.framing import Allocate
from volsplat.protocol.wire.shared_memory import ReadBlocks


class ImageReceiver:
    """The receiving thread takes `pixels` of each image, in their order; any thread may ask for `news`."""

    def __init__(self, connection: Connection, allocate: Allocate) -> None:
        self._connection = connection
        self._allocate = allocate
        self._decoder = ImageDecoder()
        self._lock = threading.Lock()  # guards what follows
        self._memory = 0
        self._blocks: ReadBlocks | None = None
        self._came = (0, 0.0, 0.0)  # of the newest with a payload: bytes, and seconds to arrive and to be decoded

    def pixels(self, image: ImageRead, payload: memoryview) -> memoryview:
        """Float32 RGBA, associated. Raises RemoteProtocolError."""
        match image.pixels:
            case RawPixels():
                self._note_arrival(image, 0.0)
                return payload
            case CodedPixels() as coded:
                began = time.perf_counter()
                target = memoryview(self._allocate(image, image.raw_bytes)).cast("B")[: image.raw_bytes]
                self._decoder.decode(image, coded, payload, target)
                self._note_arrival(image, time.perf_counter() - began)
                return target
            case SharedPixels() as shared:
                return self._block(shared)[: image.raw_bytes]

    def news(self) -> ImagesTaken | None:
        """For the splat server, before it is asked for the next image; None if there is nothing new."""
        with self._lock:
            freed = self._blocks.freed() if self._blocks is not None else []
            came, self._came = self._came, (0, 0.0, 0.0)
            return ImagesTaken(*came, self._memory, freed) if freed or came[0] else None

    def _note_arrival(self, image: ImageRead, decoding_seconds: float) -> None:
        with self._lock:
            self._came = (image.payload_bytes(), self._connection.counters.seconds_in_message, decoding_seconds)

    def _block(self, shared: SharedPixels) -> memoryview:
        with self._lock:
            if shared.first:
                self._blocks = ReadBlocks(self._connection.descriptors.take(), shared.blocks, shared.block_bytes)
                self._memory = shared.memory
            if self._blocks is None or shared.memory != self._memory:
                raise RemoteProtocolError(f"an image lies in memory {shared.memory}, which is not shared")
            return memoryview(self._blocks.taken(shared.block))
