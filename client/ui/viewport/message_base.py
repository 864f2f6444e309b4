"""The base of all that a viewport and the client's process say to each other."""

import msgspec


class Said(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    """Base of what is said, either way."""
