"""Every message of an open connection: one immutable, strictly checked struct each.

The docstring says who sends it to whom; message_rules.py holds the same as a table, with the payloads.
"""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from volsplat.protocol.description.block_extremes import MOST_BLOCKS
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene, Step
from volsplat.protocol.description.volume import LONGEST_AXIS, MOST_VOXELS, Box, Geometry, Index, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.rules.levels import Prepared, Resolution
from volsplat.protocol.text.printable import printable

LARGEST_ID = 2**31 - 1
LARGEST_COUNT = 2**62
MAX_SERVERS = 4096
MAX_BOXES = 4096
MOST_LEVELS = 32
LONGEST_LINE = 1000  # characters
LONGEST_PATH = 4096
WORKER_KEY_BYTES = 32

ServerId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # given by the client at Welcome, never used again
FrameId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # rises with each image request of a session
ProbeId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # rises with each probe of a session
AssignmentId = Annotated[int, Meta(ge=1, le=LARGEST_ID)]  # one partition of the volume among the workers
Count = Annotated[int, Meta(ge=0, le=LARGEST_COUNT)]
Ordinal = Annotated[int, Meta(ge=0, le=2**32 - 1)]  # as in a row run
Seconds = Annotated[float, Meta(ge=0)]
Extent = Annotated[int, Meta(ge=1, le=LARGEST_EXTENT)]
LevelNumber = Annotated[int, Meta(ge=0, lt=MOST_LEVELS)]
WorkerKey = Annotated[
    bytes, Meta(min_length=WORKER_KEY_BYTES, max_length=WORKER_KEY_BYTES)
]  # drawn by the client, for one worker and the splat servers
Port = Annotated[int, Meta(ge=1, le=65535)]
Line = Annotated[str, Meta(max_length=LONGEST_LINE)]
Path = Annotated[str, Meta(min_length=1, max_length=LONGEST_PATH)]
ScalarType = Literal[
    "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float32", "float64"
]  # as in volume.SCALAR_BYTES
ServerIds = Annotated[list[ServerId], Meta(max_length=MAX_SERVERS)]


class Message(msgspec.Struct, frozen=True, tag=True, tag_field="message", forbid_unknown_fields=True):
    """Base of all messages: immutable, told apart by their name, strict about unknown fields."""


class Detail(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base of what messages are made of."""


class Route(Detail, frozen=True):
    """Where a splat server takes data links, and the key that proves which worker the link is of."""

    server: ServerId
    host: Line
    port: Port
    key: WorkerKey


class MapShadeStats(Detail, frozen=True):
    """What a frame cost one map/shade server.

    Seconds follow each other: planning, then map/shade and sending by turns. `waiting_seconds` is the part of sending
    that back-pressure held up.
    """

    voxels_visited: Count
    packets: Count
    batches: Count
    bytes: Count
    planning_seconds: Seconds
    map_shade_seconds: Seconds
    sending_seconds: Seconds
    waiting_seconds: Seconds
    peak_memory_bytes: Count
    machine: Machine


class SplatStats(Detail, frozen=True):
    """What a frame cost the splat server.

    `frame_seconds` passed from taking the request to the finished image; in them it planned the frame, splatted and
    published, and, while nothing was splatted, merged, waited and answered requests for partial images.
    `held_back_seconds` tells for each worker how long its connection was not read because its buffers were full.
    `hidden_packets` came, but were left out as hidden.
    """

    packets: Count
    hidden_packets: Count
    bytes: Count
    frame_seconds: Seconds
    planning_seconds: Seconds
    merge_seconds: Seconds
    splat_seconds: Seconds
    waiting_seconds: Seconds
    answering_seconds: Seconds
    held_back_seconds: dict[ServerId, Seconds]
    peak_memory_bytes: Count
    machine: Machine


class ProbedVoxel(Detail, frozen=True):
    """A voxel of the picture.

    Its values are those that it is drawn with: of 256 steps, and where they are beyond the density window or the
    greatest strength that steps are made for, those ends.
    """

    index: Index
    density: float  # in the data's own units
    strength: float  # |gradient|, in these per unit of physical length; or the second scalar


class Part(Detail, frozen=True):
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


# The volume: client and map/shade servers.


class DescribeVolume(Message, frozen=True):
    """Client to map/shade server: tell what the volume at `path` is, without reading its voxels."""

    path: Path


class VolumeDescribed(Message, frozen=True):
    """Map/shade server to client: the answer to DescribeVolume.

    Of a volume that was prepared, what was decided then follows; the payload is that of HistogramsCounted.
    Whoever reads the volume for this session must find the same `identity`.
    """

    description: VolumeDescription
    prepared: Annotated[list[Prepared], Meta(max_length=1)]
    identity: VolumeIdentity


class ReadSubCubes(Message, frozen=True):
    """Client to map/shade server: read these boxes and their halo, and survey them. Replaces what was held.

    Boxes that are not to be held are surveyed a few sheets at a time, and again when histograms are asked for.
    Refused, as all that reads the volume, where it is not the one that was described, before and after it is read.
    """

    assignment: AssignmentId
    path: Path
    boxes: Annotated[list[Box], Meta(min_length=1, max_length=MAX_BOXES)]
    identity: VolumeIdentity
    held: bool = True

    def __post_init__(self) -> None:
        _check_boxes(self.boxes)


class SubCubesRead(Message, frozen=True):
    """Map/shade server to client: the boxes are held; `survey` counts their voxels, halos left out."""

    assignment: AssignmentId
    survey: Survey
    bytes: Count
    seconds: Seconds


class LendVolume(Message, frozen=True):
    """Client to map/shade server: read the whole volume, for others to get theirs from it. Replaces what was held.

    It is let go by ReadSubCubes of the same assignment, which takes this server's own boxes from it.
    """

    assignment: AssignmentId
    path: Path
    identity: VolumeIdentity


class VolumeLent(Message, frozen=True):
    """Map/shade server to client: the volume is in memory; it has values of these types, one scalar or two."""

    assignment: AssignmentId
    scalar_types: Annotated[list[ScalarType], Meta(min_length=1, max_length=2)]
    bytes: Count
    seconds: Seconds


class ReadPart(Message, frozen=True):
    """Client to map/shade server: send this part of the volume that you lend."""

    assignment: AssignmentId
    part: Part


class PartRead(Message, frozen=True):
    """Map/shade server to client: payload the part's values shaped (k, j, i), i fastest."""

    assignment: AssignmentId
    part: Part


class AwaitParts(Message, frozen=True):
    """Client to map/shade server: these boxes and their halo will come in parts. Replaces what was held.

    Nothing answers it; SubCubesRead comes once the last part is held.
    """

    assignment: AssignmentId
    description: VolumeDescription
    boxes: Annotated[list[Box], Meta(min_length=1, max_length=MAX_BOXES)]

    def __post_init__(self) -> None:
        _check_boxes(self.boxes)


class HoldPart(Message, frozen=True):
    """Client to map/shade server: keep these values; the payload is that of PartRead."""

    assignment: AssignmentId
    part: Part


class PartHeld(Message, frozen=True):
    """Map/shade server to client: the part is kept, the next one may come."""

    assignment: AssignmentId


class CountHistograms(Message, frozen=True):
    """Client to map/shade server: count values over low..high and gradient strengths over 0..max_gradient.

    Of a volume with a second scalar that is counted in their place, over the range that its description states.
    """

    assignment: AssignmentId
    low: float
    high: float
    max_gradient: float


class HistogramsCounted(Message, frozen=True):
    """Map/shade server to client: payload `bins` int64 of density, then `bins` int64 of strength, then float64 of least
    values of the whole volume's `blocks`, then of their greatest (block_extremes).
    """

    assignment: AssignmentId
    bins: Annotated[int, Meta(ge=1, le=HISTOGRAM_BINS)]
    blocks: Annotated[int, Meta(ge=1, le=MOST_BLOCKS**3)]


class PackVoxels(Message, frozen=True):
    """Client to map/shade server: make the voxel packets of the held boxes by the rules of the whole volume."""

    assignment: AssignmentId
    quantisation: Quantisation


class VoxelsPacked(Message, frozen=True):
    """Map/shade server to client: the voxel packets of the assignment are ready for frames."""

    assignment: AssignmentId
    voxels: Count
    bytes: Count
    seconds: Seconds


class DescribeMachine(Message, frozen=True):
    """Client to map/shade server: tell what your machine has left."""


class MachineDescribed(Message, frozen=True):
    """Map/shade server to client: the memory that it could take."""

    memory_bytes: Count


class LevelBoxes(Detail, frozen=True):
    """Boxes of one level's grid."""

    level: LevelNumber
    boxes: Annotated[list[Box], Meta(max_length=MAX_BOXES)]

    def __post_init__(self) -> None:
        _check_boxes(self.boxes)


class OpenPackets(Message, frozen=True):
    """Client to map/shade server: hold these boxes of a volume that was prepared. VoxelsPacked answers it.

    Replaces what was held.
    """

    assignment: AssignmentId
    path: Path
    levels: Annotated[list[LevelBoxes], Meta(max_length=MOST_LEVELS)]
    identity: VolumeIdentity


class InviteWorkers(Message, frozen=True):
    """Client to splat server: take the data links of these workers, by their keys, and of no other.

    Nothing answers it. A link that comes before its invitation is closed, and its worker dials again.
    """

    keys: Annotated[dict[ServerId, WorkerKey], Meta(max_length=MAX_SERVERS)]


class ConnectToSplatServers(Message, frozen=True):
    """Client to map/shade server: have a data link to each of these splat servers and to no other."""

    routes: Annotated[list[Route], Meta(max_length=MAX_SERVERS)]


class ConnectedToSplatServers(Message, frozen=True):
    """Map/shade server to client: the data links stand."""

    servers: ServerIds


# A frame.


class RenderFrame(Message, frozen=True):
    """Client to map/shade server and splat server: begin this frame; it ends any older one.

    All servers of a frame get the same `assignment`; a server that holds another refuses. `workers` are the
    map/shade servers whose batches make up the image. `geometry` is the volume's, whatever level is drawn.
    """

    frame: FrameId
    assignment: AssignmentId
    scene: Scene
    step: Step
    geometry: Geometry
    quantisation: Quantisation
    resolution: Resolution
    workers: ServerIds


class AbortFrame(Message, frozen=True):
    """Client to map/shade server and splat server: stop this frame."""

    frame: FrameId


class FrameAborted(Message, frozen=True):
    """Map/shade server or splat server to client: nothing more of this frame will be sent or splatted."""

    frame: FrameId


class FrameMapped(Message, frozen=True):
    """Map/shade server to client: all batches of the frame are on their way."""

    frame: FrameId
    stats: MapShadeStats


class FrameFinished(Message, frozen=True):
    """Splat server to client: the image will not change any more. `lost` are workers it had to do without.

    Where there are none, the image follows in an ImageRead of its own accord.
    """

    frame: FrameId
    complete: bool
    lost: ServerIds
    stats: SplatStats


class ReadImage(Message, frozen=True):
    """Client to splat server: send the image buffer of this frame as it is now, before it is finished."""

    frame: FrameId


class ImageRead(Message, frozen=True):
    """Splat server to client: payload (height, width, 4) float32, RGBA 0..1, alpha associated, top row first."""

    frame: FrameId
    step: Step
    complete: bool
    width: Extent
    height: Extent


class Batch(Message, frozen=True):
    """Map/shade data link to splat server: the next shaded packets of `worker`, in traversal order.

    The payload holds the row runs, then the shaded packets (see packet_layout). `sequence` counts a frame's batches
    of one worker from 0. Everything that the worker has before row (reached_sheet, reached_row) has been sent, this
    batch included; after `last` nothing of the frame follows. A batch may be empty to say only that.
    """

    frame: FrameId
    worker: ServerId
    sequence: Count
    encoding: Line
    run_count: Ordinal
    packet_count: Ordinal
    reached_sheet: Ordinal
    reached_row: Ordinal
    last: bool

    def __post_init__(self) -> None:
        if self.run_count > self.packet_count or (self.packet_count and not self.run_count):
            raise ValueError(
                f"each run holds a packet and each packet is in a run, but run_count is {self.run_count} and "
                f"packet_count is {self.packet_count}"
            )


class TilesClosed(Message, frozen=True):
    """Splat server to map/shade data link: no sample of this frame can change these parts of the image any more.

    The payload is the map of closed tiles (see closed_tiles) of an image of `width` x `height` pixels. Samples that
    reach closed tiles only may be left out from now on.
    """

    frame: FrameId
    width: Extent
    height: Extent


# Between frames, or between two batches of one.


class ProbeVoxels(Message, frozen=True):
    """Client to map/shade server: which of your voxels is seen at this point of the scene's image (see line_of_sight)?

    x and y are pixels from the centre of the image's top left pixel, x to the right and y down. The voxels are those of
    the resolution's level; the index in the answer is the volume's, of `geometry`.
    """

    probe: ProbeId
    assignment: AssignmentId
    scene: Scene
    geometry: Geometry
    quantisation: Quantisation
    resolution: Resolution
    x: float
    y: float


class VoxelProbed(Message, frozen=True):
    """Map/shade server to client: the front-most voxel there that is not transparent, or none."""

    probe: ProbeId
    voxels: Annotated[list[ProbedVoxel], Meta(max_length=1)]


# The session.


class Refused(Message, frozen=True):
    """Map/shade server or splat server to client: a request cannot be met, for the cause given in one line.

    `request` is the message's name; `frame`, `assignment` and `probe` are the request's, 0 where it carries none.
    `peer_lost`: not for what was asked, but because another server is gone or cannot be reached.
    `held` is the assignment that a map/shade server still holds, 0 for none.
    """

    request: Line
    cause: Line
    frame: Annotated[int, Meta(ge=0, le=LARGEST_ID)] = 0
    assignment: Annotated[int, Meta(ge=0, le=LARGEST_ID)] = 0
    peer_lost: bool = False
    probe: Annotated[int, Meta(ge=0, le=LARGEST_ID)] = 0
    held: Annotated[int, Meta(ge=0, le=LARGEST_ID)] = 0

    def __post_init__(self) -> None:
        for field in ("request", "cause"):  # they will be shown
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))


class EndSession(Message, frozen=True):
    """Client to map/shade server and splat server: the session is over, exit. Nothing follows it."""


def _check_boxes(boxes: list[Box]) -> None:
    for box in boxes:
        if min(box.low) < 0 or min(box.size) < 1:
            raise ValueError(f"a box must have 0 <= low < high on each axis, not {box.low} to {box.high}")
        if max(box.high) > LONGEST_AXIS or box.voxels > MOST_VOXELS:
            raise ValueError(f"a box of {box.size} voxels from {box.low} on lies in no volume")


RAW: Literal["raw"] = "raw"  # the one encoding of batches so far
