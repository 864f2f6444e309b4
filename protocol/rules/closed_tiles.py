"""Which parts of the image no sample can change any more (design, section 4: frozen pixels, front-to-back).

The image is divided into tiles. A tile is *closed* once each of its pixels is frozen. A sample that reaches closed
tiles only is hidden: leaving it out gives the same bits. The map of closed tiles is an array of 64-bit words, a
row of words for each row of tiles; bit n of word m is tile column 64 m + n. Within a frame bits only rise, so
that a map may be old, or read while it is written: that costs time, never bits.
"""

FROZEN_ALPHA = 1.0 - 1.0 / 1024.0  # front-to-back: from here on a pixel no longer changes
TILE_SIDE = 4  # pixels
WORD_TILES = 64
WORD_BYTES = 8


def tile_map_bytes(width: int, height: int) -> int:
    rows, words = tile_map_shape(width, height)
    return rows * words * WORD_BYTES


def new_tile_map(width: int, height: int) -> memoryview:
    """A map with no tile closed: uint64 shaped `tile_map_shape`."""
    return memoryview(bytearray(tile_map_bytes(width, height))).cast("Q", tile_map_shape(width, height))


def tile_map_shape(width: int, height: int) -> tuple[int, int]:
    """Rows of tiles, and words of each, of an image of so many pixels."""
    rows, columns = -(-height // TILE_SIDE), -(-width // TILE_SIDE)
    return rows, -(-columns // WORD_TILES)
