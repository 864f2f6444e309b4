"""Decodes the images of one splat server, in their order (protocol.image_tiles)."""

import zstandard

from volsplat.client._kernels import FloatTiles, LevelTiles
from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead
from volsplat.protocol.rules.image_tiles import image_tiles, tile_bytes
from volsplat.protocol.text.errors import RemoteProtocolError


class ImageDecoder:
    """One thread calls it, with every image that is coded."""

    def __init__(self) -> None:
        self._place: tuple[object, ...] = ()
        self._tiles: FloatTiles | LevelTiles | None = None

    def decode(self, image: ImageRead, pixels: CodedPixels, payload: memoryview, target: memoryview) -> None:
        """Make `target` the image's pixels. Raises RemoteProtocolError for a payload that is none."""
        place = (image.left, image.top, image.width, image.height, pixels.exact)
        rows, columns = image_tiles(image.width, image.height)
        changed, coded = _parted(payload, rows * columns)
        count = changed.bit_count()
        planes = _decompressed(coded, count * tile_bytes(pixels.exact))
        if not pixels.follows:
            self._place = place
            kind = FloatTiles if pixels.exact else LevelTiles
            self._tiles = kind(image.width, image.height)
        elif place != self._place:
            raise RemoteProtocolError(f"the image of frame {image.frame} follows another one that has not come")
        assert self._tiles is not None
        self._tiles.take(payload[: len(payload) - len(coded)], count, planes)
        self._tiles.lay_out(target)


def _parted(payload: memoryview, tiles: int) -> tuple[int, memoryview]:
    """The bits that say which tiles have changed, as a number, and their planes."""
    length = -(-tiles // 8)
    changed = int.from_bytes(payload[:length], "little")
    if len(payload) < length or changed >> tiles:
        raise RemoteProtocolError(f"an image of {tiles} tiles does not say which have changed")
    return changed, payload[length:]


def _decompressed(coded: memoryview, expected: int) -> bytes:
    """So many bytes. Nothing is allocated before the size that is announced is known to be right."""
    try:
        if (size := zstandard.frame_content_size(coded)) != expected:
            raise RemoteProtocolError(f"the planes of an image have {size} bytes, but {expected} are announced")
        planes = zstandard.ZstdDecompressor().decompress(coded, max_output_size=expected, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise RemoteProtocolError(f"the planes of an image cannot be decompressed: {error}") from error
    if len(planes) != expected:
        raise RemoteProtocolError(f"the planes of an image have {len(planes)} bytes, but {expected} are announced")
    return planes
