"""Codes images for the client: the tiles of each that have changed since the one before (protocol.image_tiles)."""

import time

import zstandard

from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead
from volsplat.protocol.rules.image_tiles import image_tiles, tile_bytes
from volsplat.splat_server._kernels import FloatTiles, LevelTiles

LEVEL = 1  # of zstd; higher ones hardly save bytes


class ImageCoder:
    """One connection's, which decodes them in their order. One thread calls it."""

    def __init__(self) -> None:
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)
        self._tiles: FloatTiles | LevelTiles | None = None
        self._place: tuple[object, ...] = ()  # whose tiles these are
        self._changed = self._planes = bytearray()

    def coded(self, image: ImageRead, pixels: memoryview, exact: bool) -> tuple[CodedPixels, tuple[bytearray, bytes]]:
        """How the image is told, and its payload."""
        began = time.perf_counter()
        place = (image.left, image.top, image.width, image.height, exact)
        follows = place == self._place
        if not follows:
            self._begin(image.width, image.height, exact)
            self._place = place
        assert self._tiles is not None
        count = self._tiles.note(pixels, self._changed)
        planes = memoryview(self._planes)[: count * tile_bytes(exact)]
        self._tiles.planes(self._changed, count, planes)
        payload = self._changed, self._compressor.compress(planes)
        size = len(payload[0]) + len(payload[1])
        return CodedPixels(exact, follows, size, time.perf_counter() - began), payload

    def forget(self) -> None:
        """The next image follows none: one has gone another way."""
        self._place = ()

    def _begin(self, width: int, height: int, exact: bool) -> None:
        rows, columns = image_tiles(width, height)
        self._tiles = FloatTiles(width, height) if exact else LevelTiles(width, height)
        self._changed = bytearray(-(-rows * columns // 8))
        self._planes = bytearray(rows * columns * tile_bytes(exact))
