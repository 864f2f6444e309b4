"""The image buffer: float32 RGBA with associated alpha, splatted into by stripes, readable at any time."""

from volsplat.protocol.closed_tiles import tile_map_shape
from volsplat.protocol.scene import Order
from volsplat.splat_server import _kernels
from volsplat.splat_server._kernels import CellMap, EdgeLayer, FootprintTable, ImageMemory, SpanList, StripePool
from volsplat.splat_server.pixel_reach import PixelReach

THREADED_FROM = 4096  # packets …
THREADED_FROM_PIXELS = 1 << 17  # … or pixels under them: below both, handing out stripes costs more than it saves


class ImageBuffer:
    """Kept by rows, or by columns: what is splatted into it is reached by lines that are one or the other.

    `threads` stripes of lines are splatted at once, one for each line of tiles at most; their number changes no bits.
    One thread at a time may call `splat`; others may take a `snapshot` or read `closed_tiles` meanwhile.
    """

    def __init__(self, width: int, height: int, threads: int = 1, by_columns: bool = False) -> None:
        self.width = width
        self.height = height
        self.by_columns = by_columns
        self._memory = ImageMemory(width, height, by_columns)
        tile_lines, _ = tile_map_shape(height, width) if by_columns else tile_map_shape(width, height)
        threads = min(threads, tile_lines)
        self._pool = StripePool(threads) if threads > 1 else None

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

    def clear(self) -> None:
        self._memory.clear()

    def splat(self, spans: SpanList, reach: PixelReach, order: Order, pixels_per_packet: int = 1) -> None:
        """Combine the spans' samples with the buffer, in their order. `pixels_per_packet` says what to thread.

        `reach` is by columns if the buffer is (see pixel_reach).
        """
        few = spans.packets < THREADED_FROM and spans.packets * pixels_per_packet < THREADED_FROM_PIXELS
        pool = None if few else self._pool
        front_to_back = order == Order.FRONT_TO_BACK
        if isinstance(reach, FootprintTable):
            _kernels.splat_footprints(self._memory, spans, reach, front_to_back, pool)
        elif isinstance(reach, CellMap):
            _kernels.splat_cells(self._memory, spans, reach, front_to_back, pool)
        else:
            _kernels.splat_pixels(self._memory, spans, front_to_back, pool)

    def snapshot(self) -> memoryview:
        """height x width x 4 float32, little endian, associated alpha; the caller's own until it lets go of it."""
        return self._memory.snapshot()

    def published(self, front: EdgeLayer, back: EdgeLayer) -> memoryview:
        """As `snapshot`, between two layers of edges."""
        return _kernels.published(self._memory, front, back)

    def close(self) -> None:
        """End the stripe threads."""
        if self._pool is not None:
            self._pool.close()
