"""What lies before the voxels of an array that a script shares with servers of its machine: a mark, and what it is.

The mark, the length of the description in 8 bytes, the description; from a whole page on the voxels, native, i fastest.
"""

from typing import NamedTuple

import msgspec

from volsplat.protocol.description.volume import VolumeDescription

MARK = b"volsplat-array-1"
PAGE_BYTES = 4096
LONGEST_DESCRIPTION = 1 << 24  # bytes
_LENGTH_BYTES = 8


class SharedArray(NamedTuple):
    description: VolumeDescription
    offset: int  # of the first voxel


def packed_header(description: VolumeDescription) -> bytes:
    """All that lies before the voxels."""
    told = msgspec.msgpack.encode(description)
    header = MARK + len(told).to_bytes(_LENGTH_BYTES, "little") + told
    return header + bytes(-len(header) % PAGE_BYTES)


def header_bytes(head: bytes) -> int:
    """How long the header is that begins so. Raises ValueError if it cannot be one."""
    start = len(MARK) + _LENGTH_BYTES
    length = int.from_bytes(head[len(MARK) : start], "little")
    if len(head) < start or length > LONGEST_DESCRIPTION:
        raise ValueError("its header is cut short or too long")
    return start + length + -(start + length) % PAGE_BYTES


def shared_array(header: bytes) -> SharedArray:
    """What a whole header tells. Raises ValueError."""
    start = len(MARK) + _LENGTH_BYTES
    length = int.from_bytes(header[len(MARK) : start], "little")
    return SharedArray(_DESCRIPTIONS.decode(header[start : start + length]), len(header))


_DESCRIPTIONS = msgspec.msgpack.Decoder(VolumeDescription)
