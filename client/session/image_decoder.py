"""Decodes the images of one splat server, in their order (protocol.image_tiles)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead
from volsplat.protocol.rules.image_tiles import CHANNELS, IMAGE_TILE_SIDE, image_tiles, tile_bytes
from volsplat.protocol.text.errors import RemoteProtocolError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TILE = (IMAGE_TILE_SIDE, IMAGE_TILE_SIDE)


class ImageDecoder:
    """One thread calls it, with every image that is coded."""

    def __init__(self) -> None:
        self._place: tuple[object, ...] = ()
        self._tiles: NDArray[Any] | None = None  # rows x columns of tiles, of channels, of 8 bits or the floats' 32

    def decode(self, image: ImageRead, pixels: CodedPixels, payload: memoryview, target: memoryview) -> None:
        """Make `target` the image's pixels. Raises RemoteProtocolError for a payload that is none."""
        place = (image.left, image.top, image.width, image.height, pixels.exact)
        rows, columns = image_tiles(image.width, image.height)
        if not pixels.follows:
            import numpy as np  # a session must not wait for it before it starts its servers

            self._place = place
            self._tiles = np.zeros((rows, columns, CHANNELS, *TILE), np.uint32 if pixels.exact else np.uint8)
        elif place != self._place:
            raise RemoteProtocolError(f"the image of frame {image.frame} follows another one that has not come")
        assert self._tiles is not None
        changed, planes = _unpacked(payload, rows * columns, pixels.exact)
        self._tiles.reshape(-1, CHANNELS, *TILE)[changed] = _predicted(planes, pixels.exact).swapaxes(0, 1)
        _lay_out(self._tiles, pixels.exact, image.width, image.height, target)


def _unpacked(payload: memoryview, tiles: int, exact: bool) -> tuple[NDArray[np.bool_], bytes]:
    """Which tiles have changed, and their planes. Nothing is allocated before its size is known to be right."""
    import numpy as np
    import zstandard

    bits, coded = payload[: -(-tiles // 8)], payload[-(-tiles // 8) :]
    flags = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")
    if len(flags) < tiles or flags[tiles:].any():
        raise RemoteProtocolError(f"an image of {tiles} tiles does not say which have changed")
    changed = flags[:tiles].astype(bool)
    expected = int(changed.sum()) * tile_bytes(exact)
    try:
        if (size := zstandard.frame_content_size(coded)) != expected:
            raise RemoteProtocolError(f"the planes of an image have {size} bytes, but {expected} are announced")
        planes = zstandard.ZstdDecompressor().decompress(coded, max_output_size=expected, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise RemoteProtocolError(f"the planes of an image cannot be decompressed: {error}") from error
    if len(planes) != expected:
        raise RemoteProtocolError(f"the planes of an image have {len(planes)} bytes, but {expected} are announced")
    return changed, planes


def _predicted(planes: bytes, exact: bool) -> NDArray[Any]:
    """Channels of tiles, from what the prediction misses each value by."""
    import numpy as np

    if exact:
        parts = np.frombuffer(planes, np.uint8).reshape(CHANNELS, 4, -1, *TILE)
        values: NDArray[Any] = np.empty((CHANNELS, parts.shape[2], *TILE), np.uint32)
        for byte in range(4):
            values.view(np.uint8).reshape(*values.shape, 4)[..., byte] = parts[:, byte]
    else:
        values = np.frombuffer(planes, np.uint8).reshape(CHANNELS, -1, *TILE)
    along_columns = np.add.accumulate(values, axis=2, dtype=values.dtype)
    return np.add.accumulate(along_columns, axis=3, dtype=values.dtype)


def _lay_out(tiles: NDArray[Any], exact: bool, width: int, height: int, target: memoryview) -> None:
    import numpy as np

    rows, columns = tiles.shape[:2]
    image = np.frombuffer(target, np.float32).reshape(height, width, CHANNELS)
    fits = image.shape[:2] == (rows * IMAGE_TILE_SIDE, columns * IMAGE_TILE_SIDE)
    whole = image if fits else np.empty((rows * IMAGE_TILE_SIDE, columns * IMAGE_TILE_SIDE, CHANNELS), np.float32)
    by_tiles = whole.reshape(rows, IMAGE_TILE_SIDE, columns, IMAGE_TILE_SIDE, CHANNELS)
    by_rows = tiles.transpose(0, 3, 1, 4, 2)
    if exact:
        by_tiles.view(np.uint32)[...] = by_rows
    else:
        np.multiply(by_rows, np.float32(1 / 255), out=by_tiles)
    if not fits:
        image[...] = whole[:height, :width]
