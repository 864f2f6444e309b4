"""What tells one volume from another of the same name, without reading it: drawn from both, a picture is wrong."""

from typing import Annotated

import msgspec
from msgspec import Meta

Digest = Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]
NOWHERE = "0" * 32
Bytes = Annotated[int, Meta(ge=0, le=2**62)]


class VolumeIdentity(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Of all files that a volume consists of. Copies of it have the same size, header and contents, wherever they lie.

    `times` counts at one place only, where any change is one: copies may have any.
    """

    size: Bytes  # of the files together
    header: Digest  # of what the first of them begins with, and of the grid that a reader finds in it
    contents: Digest  # of blocks that are taken evenly from all
    times: Digest  # of when each was last changed
    place: Digest  # of the machine and the path, or of the URL

    def at_no_place(self) -> "VolumeIdentity":
        """The same wherever the files lie. Among identities at no place, any difference of times is one."""
        return msgspec.structs.replace(self, place=NOWHERE)

    def difference(self, described: "VolumeIdentity") -> str:
        """In what this is another volume than the one that was described, for a person; "" where it is the same."""
        if self.size != described.size:
            return f"it has {self.size} bytes, not {described.size}"
        if self.header != described.header:
            return "its header differs"
        if self.contents != described.contents:
            return "its contents differ"
        if self.is_at_the_place_of(described) and self.times != described.times:
            return "its time of change differs"
        return ""

    def is_at_the_place_of(self, described: "VolumeIdentity") -> bool:
        return self.place == described.place
