"""The base of all that a viewport and the client's process say to each other."""

from typing import Any

import msgspec

HEADER_LENGTH_BYTES = 4  # little-endian, before the header of a picture or slice


class Said(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """Base of what is said, either way."""


def framed(header: Any, image: bytes) -> bytes:
    """The bytes of a picture or slice: its header's length, the header as JSON, the image."""
    encoded = msgspec.json.encode(header)
    return len(encoded).to_bytes(HEADER_LENGTH_BYTES, "little") + encoded + image
