"""What size of image a JPEG, JPEG-LS or JPEG 2000 codestream promises: its decoder makes room for that.

A file's own header may promise another one, a million times smaller.
"""

from volsplat.mapshade_server.readers.reading.bounded_unpacking import Damaged

JPEG, JPEG_2000 = b"\xff\xd8\xff", b"\xff\x4f\xff\x51"
FRAMES = (*(0xC0 + n for n in range(16) if n not in (4, 8, 12)), 0xF7)  # SOF of JPEG's kinds, and of JPEG-LS
WITHOUT_LENGTH = (0x01, *range(0xD0, 0xD9))
START_OF_SCAN = 0xDA
MOST_BOXES = 1 << 16  # bytes of JP2's boxes before its codestream


def check_codestream(packed: bytes, columns: int, rows: int) -> None:
    """Raises ValueError if a codestream of a kind that is known promises a larger image than that."""
    size = codestream_size(packed)
    if size is not None and (size[0] > columns or size[1] > rows):
        raise Damaged(f"its codestream is of {size[0]} x {size[1]} pixels, {columns} x {rows} are promised")


def codestream_size(packed: bytes) -> tuple[int, int] | None:
    """Columns and rows; None if it is of another kind, or too damaged for any decoder."""
    if packed.startswith(JPEG):
        return _jpeg_size(packed)
    if (at := packed.find(JPEG_2000, 0, MOST_BOXES)) >= 0:
        x1, y1, x0, y0 = (int.from_bytes(packed[at + n : at + n + 4], "big") for n in (8, 12, 16, 20))
        return x1 - x0, y1 - y0
    return None


def _jpeg_size(packed: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(packed) and packed[at] == 0xFF:
        marker = packed[at + 1]
        if marker in FRAMES:
            return int.from_bytes(packed[at + 7 : at + 9], "big"), int.from_bytes(packed[at + 5 : at + 7], "big")
        if marker == START_OF_SCAN:
            return None
        filled = marker == 0xFF or marker in WITHOUT_LENGTH
        at += (1 if marker == 0xFF else 2) if filled else 2 + int.from_bytes(packed[at + 2 : at + 4], "big")
    return None
