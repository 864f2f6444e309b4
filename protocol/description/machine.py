"""A machine that a process runs on, as reports name it."""

from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.text.printable import printable

LONGEST_TEXT = 255  # characters

Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]


class Machine(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a machine calls itself and what it computes with; the texts are made printable, for they are shown."""

    host: Text
    system: Text
    cpu: Text
    cores: Annotated[int, Meta(ge=1, le=1 << 20)]  # that this process may use

    def __post_init__(self) -> None:
        for field in ("host", "system", "cpu"):
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))
