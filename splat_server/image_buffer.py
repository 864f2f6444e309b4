"""The image buffer: float32 RGBA with associated alpha, splatted into by stripes, readable at any time."""

from volsplat.protocol.description.scene import Order
from volsplat.protocol.rules.closed_tiles import tile_map_shape
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import EdgeLayer, ImageMemory, SpanList, SplatQueue
from volsplat.splat_server.pixel_reach import PixelReach

THREADED_FROM = 4096  # packets …
THREADED_FROM_PIXELS = 1 << 17  # … or pixels under them: below both, handing out stripes costs more than it saves


class ImageBuffer:
    """Of `width` x `height` pixels as it is published. While it is turned, what is splatted has x and y exchanged: rows
    become columns.

    `threads` share out stripes of lines, one for each line of tiles at most; their number changes no bits.
    One thread at a time may change it; others may read `closed_tiles` meanwhile, and take a `snapshot` while it splats.
    """

    def __init__(self, width: int, height: int, threads: int = 1, turned: bool = False) -> None:
        self.width = width
        self.height = height
        self._memory = ImageMemory(width, height)
        most_threads = max(tile_map_shape(width, height)[0], tile_map_shape(height, width)[0])
        self._queue = SplatQueue(self._memory, min(threads, most_threads))
        self.clear(turned)

    def clear(self, turned: bool, busy_rows: tuple[int, int] | None = None) -> None:
        """Empty it, and drop what is still to be combined. What follows mostly reaches `busy_rows` of the plan."""
        self._queue.begin(turned, *(busy_rows or (0, self.width if turned else self.height)))

    @property
    def closed_tiles(self) -> memoryview:
        """The live map of closed tiles (protocol.closed_tiles): rows x words of uint64; rises while splatting."""
        return self._memory.closed_tiles

    @property
    def hidden_packets(self) -> int:
        """Packets left out as hidden, since `clear`, in the stripe of their first row; the next may still draw them.

        Neighbours that are looked at together count where all of them are hidden: how many are depends on the CPU path.
        """
        return self._memory.hidden_packets

    def splat(
        self, spans: SpanList, reach: PixelReach, order: Order, pixels_per_packet: int = 1, batches: object = None
    ) -> None:
        """Combine the spans' samples with the buffer, after those that came before.

        With several threads that goes on after the return; while much is unfinished, the caller helps. `batches` is
        kept until then: the spans' memory, which must not change. Without it the caller keeps that memory.
        `pixels_per_packet` says what to thread.
        """
        small = spans.packets < THREADED_FROM and spans.packets * pixels_per_packet < THREADED_FROM_PIXELS
        self._queue.splat(spans, reach, order == Order.FRONT_TO_BACK, small, batches)

    def finish(self) -> None:
        """Help until all is combined."""
        self._queue.finish()

    def hand_out(self) -> memoryview:
        """The image once all is combined, as `snapshot`. The buffer is empty then.

        The threads do both, each as soon as its stripe is through: its lines are in the caches then.
        """
        return self._queue.hand_out()

    def cancel(self) -> None:
        """Drop what is still to be combined."""
        self._queue.cancel()

    @property
    def busy(self) -> bool:
        """Whether there is something to combine."""
        return self._queue.busy

    @property
    def busy_seconds(self) -> float:
        """For how long there has been something to combine, since the buffer was made."""
        return self._queue.busy_seconds

    def snapshot(self) -> memoryview:
        """height x width x 4 float32, little endian, associated alpha; the caller's own until it lets go of it."""
        return self._memory.snapshot()

    def published(self, front: EdgeLayer, back: EdgeLayer) -> memoryview:
        """As `snapshot`, between two layers of edges."""
        return _kernels.published(self._memory, front, back)

    def close(self) -> None:
        """End the threads, and drop what is still to be combined."""
        self._queue.close()
