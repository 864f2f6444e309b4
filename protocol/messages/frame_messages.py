"""Messages about a frame: asked for by the client, mapped and shaded, splatted, read; and probes of its voxels."""

import math
from typing import Annotated, ClassVar

from msgspec import Meta

from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.image_messages import ImageRead
from volsplat.protocol.messages.message import (
    MAX_SERVERS,
    MOST_THREADS,
    AssignmentId,
    BlockCount,
    Count,
    Detail,
    FrameId,
    Message,
    Ordinal,
    QuestionId,
    Seconds,
    ServerId,
    ServerIds,
    Threads,
    asks,
    says,
)
from volsplat.protocol.messages.roles import CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT, DATA_LINK_TO_SPLAT
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, tile_map_bytes
from volsplat.protocol.rules.light_blocks import MOST_LIGHT_BLOCKS, SUM_BYTES, LightBlocks
from volsplat.protocol.rules.line_of_sight import LineOfSight
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.rules.regions import MOST_REGIONS, LineNumber, Regions, check_regions

Extent = Annotated[int, Meta(ge=1, le=LARGEST_EXTENT)]  # pixels
MOST_CHANNEL_BYTES = 8 << 30  # of one link; what is not touched of them costs nothing
LARGEST_BATCH = 1 << 24  # bytes; senders choose far less


class LinkStats(Detail, frozen=True):
    """What went over the link to one splat server; the seconds are those of all walkers together.

    Of `raw_bytes` of batches `bytes` were sent. `waiting_seconds` is the part of sending that back-pressure held up.
    """

    raw_bytes: Count
    bytes: Count
    sending_seconds: Seconds
    waiting_seconds: Seconds


class MapShadeStats(Detail, frozen=True):
    """What a frame cost one map/shade server.

    Seconds follow each other: planning, then map/shade, coding and sending by turns, those of the walker that was busy
    for the longest time. `waiting_seconds` is the part of sending that back-pressure held up, or for which it waited
    until the merge was near enough (see RenderFrame). Of `raw_bytes` of batches `bytes` were sent, fewer if batches
    were coded.
    """

    voxels_visited: Count
    packets: Count
    batches: Count
    raw_bytes: Count
    bytes: Count
    planning_seconds: Seconds
    map_shade_seconds: Seconds
    coding_seconds: Seconds
    sending_seconds: Seconds
    waiting_seconds: Seconds
    peak_memory_bytes: Count
    machine: Machine
    links: Annotated[dict[ServerId, LinkStats], Meta(max_length=MAX_SERVERS)] = {}  # by splat server


class SlabStages(Detail, frozen=True):
    """What the splatting of a frame of slabs went into; what is left of it went into publishing.

    `adding_seconds`: voxels' kernels were added to planes; `density_seconds`: their sums were brought to densities;
    `shading_seconds`: these were classified, with gradients and light; `compositing_seconds`: slabs were laid behind
    each other until pixels were opaque. The last two are measured together, and told apart by some of the tiles.
    """

    adding_seconds: Seconds
    density_seconds: Seconds
    shading_seconds: Seconds
    compositing_seconds: Seconds


class SplatStats(Detail, frozen=True):
    """What a frame cost the splat server.

    `frame_seconds` passed from taking the request to the finished image; in them it planned the frame, splatted and
    published, and, while nothing was splatted, merged and waited.
    `held_back_seconds` tells for each worker how long its connection was not read because its buffers were full.
    `decoding_seconds` went, in threads of their own, into batches that came coded.
    `hidden_packets` came, but were left out as hidden. `work` counts the splatted pixels of each row of tiles of its
    regions' lines: the next frame's regions are cut by it. `slabs` is told of frames of slabs.
    """

    packets: Count
    hidden_packets: Count
    bytes: Count
    frame_seconds: Seconds
    planning_seconds: Seconds
    merge_seconds: Seconds
    splat_seconds: Seconds
    waiting_seconds: Seconds
    held_back_seconds: dict[ServerId, Seconds]
    decoding_seconds: Seconds
    work: Annotated[list[Count], Meta(max_length=LARGEST_EXTENT // TILE_SIDE + 1)]
    peak_memory_bytes: Count
    machine: Machine
    slabs: SlabStages | None = None


class FrameMapped(Message, frozen=True):
    """Map/shade server to client: all batches of the frame are on their way. `lost` are splat servers that get none."""

    frame: FrameId
    stats: MapShadeStats
    lost: ServerIds


class FrameFinished(Message, frozen=True):
    """Splat server to client: the image will not change any more. `lost` are workers it had to do without.

    Where there are none, the image follows in an ImageRead of its own accord.
    """

    frame: FrameId
    complete: bool
    lost: ServerIds
    stats: SplatStats


class FrameProgress(Message, frozen=True):
    """Splat server to client: about what share of the frame's splatting it has done."""

    frame: FrameId
    share: Annotated[float, Meta(ge=0, le=1)]


@asks(CLIENT_TO_SPLAT, FrameProgress, at_once=MAX_SERVERS, newest=True)
class ReadProgress(Message, frozen=True):
    """Client to splat server: how far is this frame?"""

    frame: FrameId


@asks(CLIENT_TO_MAPSHADE, FrameMapped, at_once=MAX_SERVERS, newest=True)
@asks(CLIENT_TO_SPLAT, FrameFinished, ImageRead, at_once=MAX_SERVERS, newest=True)
class RenderFrame(Message, frozen=True):
    """Client to map/shade server and splat server: begin this frame; it ends any older one.

    All servers of a frame get the same `assignment`; a server that holds another refuses. `workers` are the
    map/shade servers whose batches make up the image, each with the number of its threads that walk. `regions` say
    which splat server splats which lines. A finished image that need not be `exact` may come with 8 bits a channel, as
    those before it may. If it is `paced` walkers wait for the merge where their links are slow, so as to send little
    that is hidden. Of one that is `traced` the servers keep for ReadTrace what they did when. Splat servers get the
    `light` of a frame of slabs whose scene asks for it.
    """

    frame: FrameId
    assignment: AssignmentId
    drawing: Drawing
    workers: Annotated[dict[ServerId, Threads], Meta(max_length=MAX_SERVERS)]
    regions: Regions
    exact: bool
    paced: bool = False
    traced: bool = False
    light: LightBlocks | None = None

    def __post_init__(self) -> None:
        check_regions(self.regions, self.drawing.plan.height)


class DepthsSummed(Message, frozen=True):
    """Map/shade server to client: payload uint64 sums of all `blocks` of the level (see light_blocks), (k, j, i)."""

    largest_payload: ClassVar[int] = SUM_BYTES * MOST_LIGHT_BLOCKS**3

    frame: FrameId
    assignment: AssignmentId
    blocks: Index

    def payload_bytes(self) -> int:
        if not all(1 <= count <= MOST_LIGHT_BLOCKS for count in self.blocks):
            raise ValueError(f"light passes 1 to {MOST_LIGHT_BLOCKS} blocks on an axis, not {self.blocks}")
        return SUM_BYTES * math.prod(self.blocks)


@asks(CLIENT_TO_MAPSHADE, DepthsSummed)
class SumDepths(Message, frozen=True):
    """Client to map/shade server: add up the optical depths of the voxels that you hold of each block.

    They are those of a frame of slabs that is about to be asked for.
    """

    frame: FrameId
    assignment: AssignmentId
    drawing: Drawing

    def __post_init__(self) -> None:
        if self.drawing.plan.slabs is None:
            raise ValueError(f"light passes frames of slabs, not those of step {self.drawing.plan.step}")


class FrameAborted(Message, frozen=True):
    """Map/shade server or splat server to client: nothing more of this frame will be sent or splatted."""

    frame: FrameId


@asks(CLIENT_TO_MAPSHADE, FrameAborted, at_once=MAX_SERVERS)
@asks(CLIENT_TO_SPLAT, FrameAborted, at_once=MAX_SERVERS)
class AbortFrame(Message, frozen=True):
    """Client to map/shade server and splat server: stop this frame."""

    frame: FrameId


# On a data link.


class BatchPart(Detail, frozen=True):
    """What of a batch is for one region."""

    run_count: Ordinal
    packet_count: Ordinal

    def __post_init__(self) -> None:
        if self.run_count > self.packet_count or (self.packet_count and not self.run_count):
            raise ValueError(
                f"each run holds a packet and each packet is in a run, but run_count is {self.run_count} and "
                f"packet_count is {self.packet_count}"
            )

    @property
    def bytes(self) -> int:
        return self.run_count * ROW_RUN_BYTES + self.packet_count * SHADED_PACKET_BYTES


@says(DATA_LINK_TO_SPLAT)
class ChannelsShared(Message, frozen=True):
    """Map/shade data link to splat server: batches of these walkers come through memory, whose descriptor comes along.

    Each walker has a channel of so many blocks (see kernels/channels/batch_channels.h). No Batch follows, and in the
    same memory comes word of closed tiles: no TilesClosed and no MergeReached.
    """

    walkers: Threads
    blocks: BlockCount
    block_bytes: Annotated[int, Meta(ge=1, le=LARGEST_BATCH)]

    def __post_init__(self) -> None:
        if self.walkers * self.blocks * self.block_bytes > MOST_CHANNEL_BYTES:
            raise ValueError(f"channels of more than {MOST_CHANNEL_BYTES} bytes are announced")

    @property
    def brings_memory(self) -> bool:
        return True


@says(DATA_LINK_TO_SPLAT)
class Batch(Message, frozen=True):
    """Map/shade data link to splat server: the next shaded packets of a walker of `worker`, in traversal order.

    There is a part for each region of the splat server, in their order. The payload holds of each its row runs, then
    its shaded packets (see packet_layout), or `coded_bytes` of the code of all of them (see sample_lattice). `sequence`
    counts a frame's batches of one walker from 0. Everything that the walker has before row (reached_sheet,
    reached_row) has been sent, this batch included; after `last` nothing of the frame follows from it. A batch may be
    empty to say only that.
    """

    largest_payload: ClassVar[int] = LARGEST_BATCH

    frame: FrameId
    worker: ServerId
    walker: Annotated[int, Meta(ge=0, lt=MOST_THREADS)]
    sequence: Count
    coded_bytes: Annotated[int, Meta(ge=0, le=LARGEST_BATCH)]  # 0: it is not coded
    parts: Annotated[list[BatchPart], Meta(min_length=1, max_length=MOST_REGIONS)]
    reached_sheet: Ordinal
    reached_row: Ordinal
    last: bool

    @property
    def raw_bytes(self) -> int:
        return sum(part.bytes for part in self.parts)

    def payload_bytes(self) -> int:
        if not self.coded_bytes:
            return self.raw_bytes
        if self.raw_bytes > self.largest_payload:  # before there is memory for it
            raise ValueError(f"a coded batch of {self.raw_bytes} bytes exceeds the limit of {self.largest_payload}")
        return self.coded_bytes


@says(DATA_LINK_TO_SPLAT.back)
class MergeReached(Message, frozen=True):
    """Splat server to map/shade data link: all of this frame that lies before row (sheet, row) has been splatted."""

    frame: FrameId
    sheet: Ordinal
    row: Ordinal


@says(DATA_LINK_TO_SPLAT.back)
class TilesClosed(Message, frozen=True):
    """Splat server to map/shade data link: no sample of this frame can change these parts of the image any more.

    The payload is what the map of closed tiles (see closed_tiles) of a plan `width` pixels wide has for the lines
    `begin` to before `end`, those of the splat server's regions. Samples that reach closed tiles only may be left out.
    """

    largest_payload: ClassVar[int] = tile_map_bytes(LARGEST_EXTENT, LARGEST_EXTENT)

    frame: FrameId
    width: Extent
    begin: LineNumber
    end: LineNumber

    def __post_init__(self) -> None:
        if self.begin % TILE_SIDE or self.end < self.begin:
            raise ValueError(f"closed tiles cannot be those of lines {self.begin} to {self.end}")

    def payload_bytes(self) -> int:
        return tile_map_bytes(self.width, self.end - self.begin)


# Between frames, or between two batches of one.


class ProbedVoxel(Detail, frozen=True):
    """A voxel of the picture.

    Its values are those that it is drawn with: of 256 steps, and where they are beyond the density window or the
    greatest strength that steps are made for, those ends.
    """

    index: Index
    density: float  # in the data's own units
    strength: float  # |gradient|, in these per unit of physical length; or the second scalar


class VoxelProbed(Message, frozen=True):
    """Map/shade server to client: the front-most voxel there that is not transparent, or none."""

    question: QuestionId
    voxel: ProbedVoxel | None


@asks(CLIENT_TO_MAPSHADE, VoxelProbed, at_once=1024)
class ProbeVoxels(Message, frozen=True):
    """Client to map/shade server: which of your voxels is seen on this line (see line_of_sight)?

    The voxels are those of the level; the index in the answer is the volume's.
    """

    question: QuestionId
    assignment: AssignmentId
    line: LineOfSight
    drawing: Drawing

    def __post_init__(self) -> None:
        self.line.check(self.drawing.plan)
