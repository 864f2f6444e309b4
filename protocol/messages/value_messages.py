"""Messages about what a volume's file says of single voxels, which their packets hold in 8 bits alone."""

from typing import Annotated, ClassVar

from msgspec import Meta

from volsplat.protocol.description.volume import LONGEST_AXIS, SCALAR_BYTES
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages.message import Message, QuestionId, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE
from volsplat.protocol.messages.volume_messages import Path, ScalarType

MOST_SCALARS = 2  # of a voxel

GridPlace = Annotated[int, Meta(ge=0, lt=LONGEST_AXIS)]


class VoxelRead(Message, frozen=True):
    """Map/shade server to client: payload a number of each of these types, the file's own of the voxel.

    None where as much of the file would have to be read for them that it would be missed elsewhere.
    """

    largest_payload: ClassVar[int] = MOST_SCALARS * max(SCALAR_BYTES.values())

    question: QuestionId
    scalar_types: Annotated[list[ScalarType], Meta(max_length=MOST_SCALARS)]

    def payload_bytes(self) -> int:
        return sum(SCALAR_BYTES[scalar] for scalar in self.scalar_types)


@asks(CLIENT_TO_MAPSHADE, VoxelRead)
class ReadVoxel(Message, frozen=True):
    """Client to map/shade server: what does the file say of this voxel? Answered beside frames and all else."""

    question: QuestionId
    path: Path
    identity: VolumeIdentity
    index: tuple[GridPlace, GridPlace, GridPlace]
