"""Who takes part in the protocol, and who dials whom (design, section 3.8)."""

from enum import StrEnum
from typing import NamedTuple


class Role(StrEnum):
    CLIENT = "client"
    MAPSHADE_SERVER = "map/shade server"
    SPLAT_SERVER = "splat server"
    DATA_LINK = "map/shade data link"  # a map/shade server's second connection, which carries its batches


class Way(NamedTuple):
    """One direction of a connection."""

    sender: Role
    receiver: Role

    @property
    def back(self) -> "Way":
        return Way(self.receiver, self.sender)

    def __str__(self) -> str:
        return f"{self.sender} to {self.receiver}"


CLIENT_TO_MAPSHADE = Way(Role.CLIENT, Role.MAPSHADE_SERVER)
MAPSHADE_TO_CLIENT = CLIENT_TO_MAPSHADE.back
CLIENT_TO_SPLAT = Way(Role.CLIENT, Role.SPLAT_SERVER)
SPLAT_TO_CLIENT = CLIENT_TO_SPLAT.back
DATA_LINK_TO_SPLAT = Way(Role.DATA_LINK, Role.SPLAT_SERVER)
SPLAT_TO_DATA_LINK = DATA_LINK_TO_SPLAT.back

# The senders of these dial, the receivers accept.
DIALLED = (MAPSHADE_TO_CLIENT, SPLAT_TO_CLIENT, DATA_LINK_TO_SPLAT)
