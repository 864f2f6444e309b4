"""Messages about what lies in a folder of a server's machine, of which a person may choose a volume."""

from typing import Annotated

import msgspec
from msgspec import Meta

from volsplat.protocol.description.volume_name import LONGEST_VOLUME_NAME
from volsplat.protocol.messages.message import Count, Detail, Message, QuestionId, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE
from volsplat.protocol.messages.volume_messages import Path
from volsplat.protocol.text.printable import printable

MOST_ENTRIES = 400
LONGEST_NAME = 255  # characters, of one file
LONGEST_KIND = 160

FolderName = Annotated[str, Meta(max_length=LONGEST_VOLUME_NAME)]
KindTold = Annotated[str, Meta(max_length=LONGEST_KIND)]


class FolderEntry(Detail, frozen=True):
    """A folder that can be listed, or a volume that can be opened, or both: one that may have parts, which are listed.

    `part` is the part of a volume that this entry stands for, as of a DICOM folder one series; the name is the folder's
    own then, "". `bytes` is the file's size, 0 for what is no single file.
    """

    name: Annotated[str, Meta(max_length=LONGEST_NAME)]
    part: Annotated[str, Meta(max_length=LONGEST_NAME)]
    kind: KindTold
    bytes: Count
    is_folder: bool
    is_volume: bool

    def __post_init__(self) -> None:
        msgspec.structs.force_setattr(self, "kind", printable(self.kind))  # it will be shown


class FolderListed(Message, frozen=True):
    """Map/shade server to client: what lies in the folder, folders first; `left_out` more are there."""

    question: QuestionId
    entries: Annotated[list[FolderEntry], Meta(max_length=MOST_ENTRIES)]
    left_out: Count


@asks(CLIENT_TO_MAPSHADE, FolderListed)
class ListFolder(Message, frozen=True):
    """Client to map/shade server: which volumes and folders lie in `folder`, by its way from the root at `path`?

    Or, where that names a file or a folder that is one volume, with or without a part: which (more) parts has it?

    Nothing is told of what does not lie below that root, links followed. Of names, those that contain `words`.
    Answered beside frames and all else.
    """

    question: QuestionId
    path: Path
    folder: FolderName = ""
    words: FolderName = ""
