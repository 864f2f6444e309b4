"""Messages about a slice of the volume, whatever of it can be seen in the picture."""

from typing import Annotated, ClassVar

from msgspec import Meta

from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.message import AssignmentId, Message, QuestionId, asks
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE
from volsplat.protocol.messages.volume_messages import MAX_BOXES
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import MOST_SAMPLES, SAMPLE_BYTES, SlicePlane

LARGEST_SLICE = MOST_SAMPLES**2 * SAMPLE_BYTES


class SliceRead(Message, frozen=True):
    """Map/shade server to client: the parts of the slice that it holds.

    The payload has for each of them the voxel packets, uint32 (rows, columns), then red, green, blue and opacity of
    each, a byte every one.
    """

    largest_payload: ClassVar[int] = LARGEST_SLICE

    question: QuestionId
    assignment: AssignmentId
    parts: Annotated[list[Rectangle], Meta(max_length=MAX_BOXES)]

    def __post_init__(self) -> None:
        for part in self.parts:
            if not (0 < part.width <= MOST_SAMPLES and 0 < part.height <= MOST_SAMPLES):
                raise ValueError(f"a part of a slice has 1 to {MOST_SAMPLES} samples a side, not {part}")

    def payload_bytes(self) -> int:
        return SAMPLE_BYTES * sum(part.width * part.height for part in self.parts)


@asks(CLIENT_TO_MAPSHADE, SliceRead)
class ReadSlice(Message, frozen=True):
    """Client to map/shade server: send what you hold of this slice, with the colours that its voxels are drawn in.

    The plane is one of the level's grid, and the plan of step F of the scene that the colours are of.
    """

    question: QuestionId
    assignment: AssignmentId
    plane: SlicePlane
    drawing: Drawing
