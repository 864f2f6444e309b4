"""The image buffer: float32 RGBA with associated alpha, splatted into by stripes, readable at any time."""

from concurrent.futures import ThreadPoolExecutor

from volsplat.protocol.scene import Order
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import CellMap, EdgeLayer, FootprintTable, ImageMemory, SpanList
from volsplat.splat_server.pixel_reach import PixelReach

THREADED_FROM = 4096  # packets …
THREADED_FROM_PIXELS = 1 << 17  # … or pixels under them: below both, handing out stripes costs more than it saves


class ImageBuffer:
    """`threads` stripes of rows are splatted at once; the bits do not depend on their number.

    One thread at a time may call `splat`; another may take a `snapshot` meanwhile.
    """

    def __init__(self, width: int, height: int, threads: int = 1) -> None:
        self.width = width
        self.height = height
        self.threads = max(1, min(threads, height))
        self._memory = ImageMemory(width, height)
        self._pool = ThreadPoolExecutor(self.threads - 1, "splat-stripe") if self.threads > 1 else None

    def clear(self) -> None:
        self._memory.clear()

    def splat(self, spans: SpanList, reach: PixelReach, order: Order, pixels_per_packet: int = 1) -> None:
        """Combine the spans' samples with the buffer, in their order. `pixels_per_packet` says what to thread."""
        few = spans.packets < THREADED_FROM and spans.packets * pixels_per_packet < THREADED_FROM_PIXELS
        if self._pool is None or few:
            self._splat_rows(spans, reach, order, 0, self.height)
            return
        ends = [self.height * n // self.threads for n in range(self.threads + 1)]
        others = [
            self._pool.submit(self._splat_rows, spans, reach, order, ends[n], ends[n + 1])
            for n in range(1, self.threads)
        ]
        self._splat_rows(spans, reach, order, ends[0], ends[1])
        for other in others:
            other.result()

    def snapshot(self) -> bytes:
        """height x width x 4 float32, little endian, associated alpha."""
        return self._memory.snapshot()

    def published(self, front: EdgeLayer, back: EdgeLayer) -> bytes:
        """As `snapshot`, between two layers of edges."""
        return _kernels.published(self._memory, front, back)

    def close(self) -> None:
        """End the stripe threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _splat_rows(self, spans: SpanList, reach: PixelReach, order: Order, begin: int, end: int) -> None:
        front_to_back = order == Order.FRONT_TO_BACK
        if isinstance(reach, FootprintTable):
            _kernels.splat_footprints(self._memory, spans, reach, front_to_back, begin, end)
        elif isinstance(reach, CellMap):
            _kernels.splat_cells(self._memory, spans, reach, front_to_back, begin, end)
        else:
            _kernels.splat_pixels(self._memory, spans, front_to_back, begin, end)
