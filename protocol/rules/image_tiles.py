"""How an image is coded: which of its tiles have changed, and these by planes, predicted and compressed.

Tiles are squares, row by row from the top; at the right and lower rims zeros fill them up. The coded image is a bit for
each tile, the lowest of each byte first, that says whether it has changed; then a zstd frame, which holds, of all that
have changed, their red, green, blue and alpha plane: 8 bits for each pixel, or, where each bit counts, the 32 of the
float, as four planes of bytes, the lowest first. In place of a value stands what a plane through its left, upper and
upper left neighbours in the tile misses it by, modulo 2^8 or 2^32; outside of the tile all is 0.
"""

IMAGE_TILE_SIDE = 32  # pixels
IMAGE_TILE_PIXELS = IMAGE_TILE_SIDE * IMAGE_TILE_SIDE
CHANNELS = 4


def image_tiles(width: int, height: int) -> tuple[int, int]:
    """Rows and columns of tiles."""
    return -(-height // IMAGE_TILE_SIDE), -(-width // IMAGE_TILE_SIDE)


def tile_bytes(exact: bool) -> int:
    """Of one tile, before it is compressed."""
    return IMAGE_TILE_PIXELS * CHANNELS * (4 if exact else 1)
