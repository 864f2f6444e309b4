"""Sends to the client, at once or on a thread of its own: the work goes on while a large image is on its way."""

import queue
import threading
from collections.abc import Callable
from typing import NamedTuple

from volsplat.program.frame_spans import UNTRACED, FrameSpans, clock
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.refusals import refusal, why_silent
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.wire.connection import Connection, ConnectionClosed
from volsplat.splat_server.image_sender import ImageSender

Later = Callable[[], messages.Message]
TO_CLIENT = "to client"  # the row of what is sent


class _Image(NamedTuple):
    message: messages.ImageRead
    pixels: memoryview
    exact: bool
    request: messages.Message  # whose answer it is
    spans: FrameSpans


class Outbox:
    """Messages leave in the order in which they were posted.

    One thread posts. It posts an image only while `holds_image` is False, so that no more than one waits in memory.
    """

    def __init__(
        self, client: Connection, image_sent: Callable[[], None], failed: Callable[[VolsplatError], None]
    ) -> None:
        """`image_sent` and `failed` are called by the sending thread; after `failed` nothing more is sent."""
        self.holds_image = False
        self._waited = 0  # so many were left to the sending thread …
        self._done = 0  # … which has sent so many of them
        self._client = client
        self.images = ImageSender(client)
        self._image_sent = image_sent
        self._failed = failed
        self._posted: queue.SimpleQueue[messages.Message | Later | _Image | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._send_posted, name="send to client", daemon=True)
        self._thread.start()

    def post(self, message: messages.Message) -> None:
        if not self._leaves_at_once(lambda: self._client.send_at_once(message)):
            self._leave(message)

    def post_later(self, made: Later) -> None:
        """A message that is made once all that was posted before is sent."""
        self._leave(made)

    def post_image(
        self,
        message: messages.ImageRead,
        pixels: memoryview,
        exact: bool,
        request: messages.Message,
        spans: FrameSpans = UNTRACED,
    ) -> None:
        """`message` says of what; how its pixels go is seen when they do. It answers the `request`."""
        image = _Image(message, pixels, exact, request, spans)
        if not self._leaves_at_once(lambda: self._sent_by_memory(image)):
            self.holds_image = True
            self._leave(image)

    def _leaves_at_once(self, send: Callable[[], bool]) -> bool:
        if self._waited != self._done:
            return False
        try:
            return send()
        except VolsplatError:  # the sending thread will find the same, and reports it
            return False

    def _sent_by_memory(self, image: _Image) -> bool:
        """Whether the client sees the image's memory, and has been told of it without waiting."""
        if not (self.images.shares(image.pixels) and self._client.has_room):
            return False
        self._send_image(image)
        return True

    def _leave(self, posted: messages.Message | Later | _Image) -> None:
        self._waited += 1
        self._posted.put(posted)

    def close(self) -> None:
        """End the thread. The client's connection must be closed already: it wakes a send that waits."""
        self._posted.put(None)
        self._thread.join()
        self.images.close()

    def _send_posted(self) -> None:
        while (posted := self._posted.get()) is not None:
            try:
                match posted:
                    case _Image():
                        self._send_or_refuse(posted)
                    case messages.Message():
                        self._client.send(posted)
                    case _:
                        self._client.send(posted())
            except ConnectionClosed:
                return
            except VolsplatError as error:
                self._failed(error)
                return
            except Exception as error:  # whatever it is: nobody else sends to the client
                self._failed(why_silent(self._client, error))
                return
            was_image = isinstance(posted, _Image)
            del posted  # an image's memory is used again once nobody holds it
            self._done += 1
            if was_image:
                self.holds_image = False
                self._image_sent()

    def _send_or_refuse(self, image: _Image) -> None:
        """What is wrong with one image, as no memory to code it in, is no reason to end."""
        try:
            self._send_image(image)
        except VolsplatError:
            raise
        except Exception as error:
            self._client.send(refusal(image.request, error))

    def _send_image(self, image: _Image) -> None:
        began = clock()
        coding_seconds = self.images.send(image.message, image.pixels, image.exact)
        ended = clock()
        image.spans.note(TO_CLIENT, "send image", began, ended)
        if coding_seconds > 0.0:
            image.spans.note(TO_CLIENT, "code image", began, min(began + coding_seconds, ended))
