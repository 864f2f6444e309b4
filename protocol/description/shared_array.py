"""What lies before the voxels of an array that a script shares with servers of its machine: a mark, and what it is.

The mark, the array's own key, the length of the description in 8 bytes, the description; from a whole page on the
voxels, native, i fastest. The key tells it from another array that a script has by the
same name, once this one is closed.
"""

import os
from typing import NamedTuple

import msgspec

from volsplat.protocol.description.volume import VolumeDescription

MARK = b"volsplat-array-1"
PAGE_BYTES = 4096
LONGEST_DESCRIPTION = 1 << 24  # bytes
_KEY_BYTES = 16
_LENGTH_BYTES = 8
_TOLD_FROM = len(MARK) + _KEY_BYTES
_DESCRIBED_FROM = _TOLD_FROM + _LENGTH_BYTES


class SharedArray(NamedTuple):
    description: VolumeDescription
    offset: int  # of the first voxel
    key: str


def packed_header(description: VolumeDescription) -> bytes:
    """All that lies before the voxels."""
    told = msgspec.msgpack.encode(description)
    header = MARK + os.urandom(_KEY_BYTES) + len(told).to_bytes(_LENGTH_BYTES, "little") + told
    return header + bytes(-len(header) % PAGE_BYTES)


def header_bytes(head: bytes) -> int:
    """How long the header is that begins so. Raises ValueError if it cannot be one."""
    length = _length(head)
    if len(head) < _DESCRIBED_FROM or length > LONGEST_DESCRIPTION:
        raise ValueError("its header is cut short or too long")
    return _DESCRIBED_FROM + length + -(_DESCRIBED_FROM + length) % PAGE_BYTES


def shared_array(header: bytes) -> SharedArray:
    """What a whole header tells. Raises ValueError."""
    description = _DESCRIPTIONS.decode(header[_DESCRIBED_FROM : _DESCRIBED_FROM + _length(header)])
    return SharedArray(description, len(header), key_of(header))


def key_of(head: bytes) -> str:
    """The key of the array whose header begins so."""
    return head[len(MARK) : _TOLD_FROM].hex()


def _length(head: bytes) -> int:
    return int.from_bytes(head[_TOLD_FROM:_DESCRIBED_FROM], "little")


_DESCRIPTIONS = msgspec.msgpack.Decoder(VolumeDescription)
