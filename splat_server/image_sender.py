"""How an image goes to the client: by memory that it sees, else by the socket, coded where it comes sooner so."""

import threading
import time

from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead, ImagesTaken, RawPixels
from volsplat.protocol.wire.connection import Connection
from volsplat.splat_server.image_coder import ImageCoder
from volsplat.splat_server.image_pace import ImagePace
from volsplat.splat_server.shared_images import SharedImages


class ImageSender:
    """Of one client. One thread takes what images are published in, one sends at a time, a third hears of them."""

    def __init__(self, client: Connection) -> None:
        self._client = client
        self._lock = threading.Lock()  # guards the two that follow
        self._shared = SharedImages()
        self._pace = ImagePace()
        self._coder = ImageCoder()

    def target(self, nbytes: int) -> memoryview | None:
        """Where to publish an image of so many bytes, so that the client sees it; None where it is to be sent."""
        with self._lock:
            return self._shared.target(nbytes) if self._client.may_share_memory else None

    def shares(self, pixels: memoryview) -> bool:
        """Whether they lie in memory that the client sees, so that it is only told of them."""
        with self._lock:
            return self._shared.hold(pixels)

    def send(self, image: ImageRead, pixels: memoryview, exact: bool) -> float:
        """The seconds that went into coding it. Raises as Connection.send does."""
        with self._lock:
            shared = self._shared.passed(pixels)
            coded = not self._client.may_share_memory and image.raw_bytes > 0 and self._pace.coding_pays(exact)
        if shared is not None:
            told, descriptor = shared
            self._client.send(image.carried_by(told), descriptor=descriptor)
            return 0.0
        began = time.perf_counter()
        carrier, payload = self._coded(image, pixels, exact) if coded else (RawPixels(), (pixels,))
        seconds = time.perf_counter() - began
        if isinstance(carrier, RawPixels):
            self._coder.forget()
        self._client.send(image.carried_by(carrier), *payload)
        return seconds if coded else 0.0

    def taken(self, message: ImagesTaken) -> None:
        """Raises RemoteProtocolError."""
        with self._lock:
            self._shared.freed(message)
            self._pace.taken(message)

    def close(self) -> None:
        with self._lock:
            self._shared.close()

    def _coded(
        self, image: ImageRead, pixels: memoryview, exact: bool
    ) -> tuple[CodedPixels | RawPixels, tuple[bytearray | bytes | memoryview, ...]]:
        """Raw if it would have more bytes coded."""
        told, payload = self._coder.coded(image, pixels, exact)
        with self._lock:
            self._pace.coded(told, image.raw_bytes)
        return (told, payload) if told.bytes < image.raw_bytes else (RawPixels(), (pixels,))
