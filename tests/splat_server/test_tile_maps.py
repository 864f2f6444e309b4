"""The map of closed tiles has room for every pixel of an image, and for no more words than that takes."""

from hypothesis import given
from hypothesis import strategies as st

from volsplat.protocol.rules.closed_tiles import TILE_SIDE, WORD_TILES, tile_map_shape

EXTENTS = st.integers(1, 16384)


@given(EXTENTS, EXTENTS)
def test_the_last_pixel_lies_in_the_last_row_and_word(width: int, height: int) -> None:
    rows, words = tile_map_shape(width, height)
    assert (height - 1) // TILE_SIDE == rows - 1
    assert (width - 1) // TILE_SIDE // WORD_TILES == words - 1
