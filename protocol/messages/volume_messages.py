"""Messages about the volume, between the client and the map/shade servers: what it is, who holds which part of it."""

import math
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from volsplat.protocol.description.block_extremes import BLOCK_BYTES, MOST_BLOCKS, block_dims
from volsplat.protocol.description.volume import LONGEST_AXIS, MOST_VOXELS, SCALAR_BYTES, Box, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.description.volume_name import LONGEST_VOLUME_NAME
from volsplat.protocol.messages.message import (
    MAX_SERVERS,
    MOST_LEVELS,
    AssignmentId,
    Count,
    Detail,
    LevelNumber,
    Message,
    Ordinal,
    ReadingId,
    Seconds,
    ServerId,
    asks,
)
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.rules.levels import Prepared

MAX_BOXES = 4096
HISTOGRAM_BYTES = 16  # two int64 for each bin
LARGEST_HISTOGRAMS = (1 << 20) + BLOCK_BYTES * MOST_BLOCKS**3
LARGEST_PART = 1 << 24  # bytes of values; senders choose less

Path = Annotated[str, Meta(min_length=1, max_length=LONGEST_VOLUME_NAME)]
ScalarType = Literal[
    "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64"
]  # as in volume.SCALAR_BYTES
SubCubes = Annotated[list[Box], Meta(min_length=1, max_length=MAX_BOXES)]  # of one server


def _check_boxes(boxes: list[Box]) -> None:
    for box in boxes:
        if min(box.low) < 0 or min(box.size) < 1:
            raise ValueError(f"a box must have 0 <= low < high on each axis, not {box.low} to {box.high}")
        if max(box.high) > LONGEST_AXIS or box.voxels > MOST_VOXELS:
            raise ValueError(f"a box of {box.size} voxels from {box.low} on lies in no volume")


class OfBoxes:
    """What messages that name boxes have alike: these are checked."""

    __slots__ = ()
    boxes: list[Box]

    def __post_init__(self) -> None:
        _check_boxes(self.boxes)


class VolumePart(Detail, frozen=True):
    """Values of a volume on their way to the server that is to hold them.

    They are a box of a sub-cube: of the halo as well where they are the volume's first scalar, whose gradients need it.
    Those of one scalar come in order, i fastest: whole sheets, or whole rows of a sheet, or samples of a row.
    """

    server: ServerId
    sub_cube: Ordinal  # by its place among the boxes that this server awaits
    scalar: Annotated[int, Meta(ge=0, le=1)]  # 1: the second one
    scalar_type: ScalarType
    box: Box

    def __post_init__(self) -> None:
        _check_boxes([self.box])

    @property
    def payload_bytes(self) -> int:
        """Of its values."""
        return self.box.voxels * SCALAR_BYTES[self.scalar_type]


class LevelBoxes(OfBoxes, Detail, frozen=True):
    """Boxes of one level's grid."""

    level: LevelNumber
    boxes: Annotated[list[Box], Meta(max_length=MAX_BOXES)]


# What it is.


class VolumeDescribed(Message, frozen=True):
    """Map/shade server to client: the answer to DescribeVolume.

    Of a volume that was prepared, what was decided then follows; the payload is that of HistogramsCounted.
    Whoever reads the volume for this session must find the same `identity`.
    """

    largest_payload: ClassVar[int] = LARGEST_HISTOGRAMS

    description: VolumeDescription
    prepared: Prepared | None
    identity: VolumeIdentity

    def payload_bytes(self) -> int:
        if self.prepared is None:
            return 0
        blocks = math.prod(block_dims(self.description.geometry.dims))
        return HISTOGRAM_BINS * HISTOGRAM_BYTES + blocks * BLOCK_BYTES


@asks(CLIENT_TO_MAPSHADE, VolumeDescribed)
class DescribeVolume(Message, frozen=True):
    """Client to map/shade server: tell what the volume at `path` is, without reading its voxels."""

    path: Path


# Its values.


class SubCubesRead(Message, frozen=True):
    """Map/shade server to client: the boxes are held; `survey` counts their voxels, halos left out."""

    assignment: AssignmentId
    survey: Survey
    seconds: Seconds


@asks(CLIENT_TO_MAPSHADE, SubCubesRead)
class ReadSubCubes(OfBoxes, Message, frozen=True):
    """Client to map/shade server: read these boxes and their halo, and survey them. Replaces what was held.

    Boxes that are not to be held are surveyed a few sheets at a time, and again when histograms are asked for.
    Refused, as all that reads the volume, where it is not the one that was described, before and after it is read.
    """

    assignment: AssignmentId
    path: Path
    boxes: SubCubes
    identity: VolumeIdentity
    held: bool = True


# One server reads it for all.


class VolumeLent(Message, frozen=True):
    """Map/shade server to client: the volume is in memory; it has values of these types, one scalar or two."""

    assignment: AssignmentId
    scalar_types: Annotated[list[ScalarType], Meta(min_length=1, max_length=2)]


@asks(CLIENT_TO_MAPSHADE, VolumeLent)
class LendVolume(Message, frozen=True):
    """Client to map/shade server: read the whole volume, for others to get theirs from it. Replaces what was held.

    It is let go by ReadSubCubes of the same assignment, which takes this server's own boxes from it.
    """

    assignment: AssignmentId
    path: Path
    identity: VolumeIdentity


class _WithPart(Message, frozen=True):
    """Base of those that bring a part's values."""

    largest_payload: ClassVar[int] = LARGEST_PART

    assignment: AssignmentId
    part: VolumePart

    def payload_bytes(self) -> int:
        return self.part.payload_bytes


class PartRead(_WithPart, frozen=True):
    """Map/shade server to client: payload the part's values shaped (k, j, i), i fastest."""


@asks(CLIENT_TO_MAPSHADE, PartRead, at_once=MAX_SERVERS)
class ReadPart(Message, frozen=True):
    """Client to map/shade server: send this part of the volume that you lend."""

    assignment: AssignmentId
    part: VolumePart


@asks(CLIENT_TO_MAPSHADE, SubCubesRead)
class AwaitParts(OfBoxes, Message, frozen=True):
    """Client to map/shade server: these boxes and their halo will come in parts. Replaces what was held.

    Nothing answers it; SubCubesRead comes once the last part is held.
    """

    assignment: AssignmentId
    description: VolumeDescription
    boxes: SubCubes


class PartHeld(Message, frozen=True):
    """Map/shade server to client: the part is kept, the next one may come."""

    assignment: AssignmentId


@asks(CLIENT_TO_MAPSHADE, PartHeld, at_once=4)  # each brings its values along
class HoldPart(_WithPart, frozen=True):
    """Client to map/shade server: keep these values; the payload is that of PartRead."""


# Its packets.


class HistogramsCounted(Message, frozen=True):
    """Map/shade server to client: payload `bins` int64 of density, then `bins` int64 of strength, then float64 of least
    values of the whole volume's `blocks`, then of their greatest (block_extremes).
    """

    largest_payload: ClassVar[int] = LARGEST_HISTOGRAMS

    assignment: AssignmentId
    bins: Annotated[int, Meta(ge=1, le=HISTOGRAM_BINS)]
    blocks: Annotated[int, Meta(ge=1, le=MOST_BLOCKS**3)]

    def payload_bytes(self) -> int:
        return self.bins * HISTOGRAM_BYTES + self.blocks * BLOCK_BYTES


@asks(CLIENT_TO_MAPSHADE, HistogramsCounted)
class CountHistograms(Message, frozen=True):
    """Client to map/shade server: count values over low..high and gradient strengths over 0..max_gradient.

    Of a volume with a second scalar that is counted in their place, over the range that its description states.
    """

    assignment: AssignmentId
    low: float
    high: float
    max_gradient: float


class VoxelsPacked(Message, frozen=True):
    """Map/shade server to client: the voxel packets of the assignment are ready for frames.

    Of their voxels so many were `read` since it was asked for; the others were there already.
    """

    assignment: AssignmentId
    read: Count
    seconds: Seconds


@asks(CLIENT_TO_MAPSHADE, VoxelsPacked)
class PackVoxels(Message, frozen=True):
    """Client to map/shade server: make the voxel packets of the held boxes by the rules of the whole volume."""

    assignment: AssignmentId
    quantisation: Quantisation


class AheadRead(Message, frozen=True):
    """Map/shade server to client: it has what it was to read ahead."""

    reading: ReadingId


@asks(CLIENT_TO_MAPSHADE, AheadRead, at_once=MAX_SERVERS, newest=True)
class ReadAhead(OfBoxes, Message, frozen=True):
    """Client to map/shade server: make the packets of these boxes that are not held, beside frames and all else.

    ChangeSubCubes then need not read them. One whose place a newer one takes may stay without an answer.
    """

    reading: ReadingId
    path: Path
    boxes: SubCubes
    identity: VolumeIdentity
    quantisation: Quantisation


@asks(CLIENT_TO_MAPSHADE, VoxelsPacked)
class ChangeSubCubes(OfBoxes, Message, frozen=True):
    """Client to map/shade server: hold the packets of these boxes from now on, made as those that are held.

    What is held of them stays; only the rest is read. Where that is refused, all that is held stays.
    """

    assignment: AssignmentId
    path: Path
    boxes: SubCubes
    identity: VolumeIdentity
    quantisation: Quantisation


@asks(CLIENT_TO_MAPSHADE, VoxelsPacked, at_once=MAX_SERVERS, newest=True)
class OpenPackets(Message, frozen=True):
    """Client to map/shade server: hold these boxes of a volume that was prepared. VoxelsPacked answers it.

    Replaces what was held, of which stays what is wanted again.
    """

    assignment: AssignmentId
    path: Path
    levels: Annotated[list[LevelBoxes], Meta(max_length=MOST_LEVELS)]
    identity: VolumeIdentity
