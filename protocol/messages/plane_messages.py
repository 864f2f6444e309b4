"""Messages about how often each density occurs with each strength among the voxels that are held."""

from typing import ClassVar

from volsplat.protocol.description.patches import COUNTS_BYTES
from volsplat.protocol.messages.message import AssignmentId, LevelNumber, Message, QuestionId, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE


class PlaneCounted(Message, frozen=True):
    """Map/shade server to client: how many of the voxels with data that it holds have each density and strength byte.

    The payload is uint64 (256 strengths, 256 densities).
    """

    largest_payload: ClassVar[int] = COUNTS_BYTES

    question: QuestionId
    assignment: AssignmentId

    def payload_bytes(self) -> int:
        return COUNTS_BYTES


@asks(CLIENT_TO_MAPSHADE, PlaneCounted)
class CountPlane(Message, frozen=True):
    """Client to map/shade server: count the voxels of a level, as they are packed now, by density and strength."""

    question: QuestionId
    assignment: AssignmentId
    level: LevelNumber
