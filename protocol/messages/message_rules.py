"""The table of messages: who may send which to whom, in which phase, and how long its payload is.

It knows nothing of bytes on the wire (see framing) nor of the handshake's order (see handshake).
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, Union

import msgspec

from volsplat.protocol.description.block_extremes import BLOCK_BYTES, MOST_BLOCKS, block_dims
from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.description.volume import SCALAR_BYTES
from volsplat.protocol.messages import greetings, messages
from volsplat.protocol.messages.exchanges import Exchanges
from volsplat.protocol.messages.messages import (
    Batch,
    HistogramsCounted,
    HoldPart,
    ImageRead,
    Message,
    PartRead,
    TilesClosed,
    VolumeDescribed,
)
from volsplat.protocol.messages.roles import (
    CLIENT_TO_MAPSHADE,
    CLIENT_TO_SPLAT,
    DATA_LINK_TO_SPLAT,
    DIALLED,
    MAPSHADE_TO_CLIENT,
    SPLAT_TO_CLIENT,
    SPLAT_TO_DATA_LINK,
    Way,
)
from volsplat.protocol.rules.closed_tiles import tile_map_bytes
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.text.errors import LocalProtocolError, RemoteProtocolError
from volsplat.protocol.text.printable import printable

MIB = 1 << 20
LARGEST_BATCH = 16 * MIB  # bytes of runs and packets; senders choose far less
LARGEST_HISTOGRAMS = MIB + BLOCK_BYTES * MOST_BLOCKS**3
LARGEST_PART = 16 * MIB  # bytes of values; senders choose less
RGBA_BYTES = 16  # four float32
HISTOGRAM_BYTES = 16  # two int64 for each bin
LARGEST_IMAGE = LARGEST_EXTENT * LARGEST_EXTENT * RGBA_BYTES
LARGEST_TILE_MAP = tile_map_bytes(LARGEST_EXTENT, LARGEST_EXTENT)


class Phase(Enum):
    """Where a connection stands, for one direction of it."""

    GREETING = "handshake"
    OPEN = "open"
    ENDED = "ended"  # EndSession was sent this way


class Payload(NamedTuple):
    """How many bytes follow a message, by what it announces, and what it may announce at most."""

    announced: Callable[[Any], int]
    limit: int


@dataclass(frozen=True)
class Rule:
    phase: Phase
    ways: tuple[Way, ...]
    payload: Payload | None = None
    ends: bool = False  # nothing may follow it this way


def _batch_bytes(batch: Batch) -> int:
    if batch.encoding != messages.RAW:
        raise ValueError(
            f"Batch.encoding is {batch.encoding!r}, but this version takes only {messages.RAW!r} batches; let both "
            "servers run the same version of volsplat"
        )
    return batch.run_count * ROW_RUN_BYTES + batch.packet_count * SHADED_PACKET_BYTES


def _description_bytes(described: VolumeDescribed) -> int:
    if not described.prepared:
        return 0
    blocks = math.prod(block_dims(described.description.geometry.dims))
    return HISTOGRAM_BINS * HISTOGRAM_BYTES + blocks * BLOCK_BYTES


def _histogram_bytes(counted: HistogramsCounted) -> int:
    return counted.bins * HISTOGRAM_BYTES + counted.blocks * BLOCK_BYTES


def _part_bytes(carried: PartRead | HoldPart) -> int:
    return carried.part.box.voxels * SCALAR_BYTES[carried.part.scalar_type]


def _image_bytes(image: ImageRead) -> int:
    return image.width * image.height * RGBA_BYTES


def _tiles_bytes(closed: TilesClosed) -> int:
    return tile_map_bytes(closed.width, closed.height)


_DIAL = DIALLED
_ACCEPT = tuple(way.back for way in DIALLED)
_TO_SERVERS = (CLIENT_TO_MAPSHADE, CLIENT_TO_SPLAT)
_FROM_SERVERS = (MAPSHADE_TO_CLIENT, SPLAT_TO_CLIENT)

RULES: dict[type[Message], Rule] = {
    greetings.Hello: Rule(Phase.GREETING, _DIAL),
    greetings.Challenge: Rule(Phase.GREETING, _ACCEPT),
    greetings.Proof: Rule(Phase.GREETING, _DIAL),
    greetings.Welcome: Rule(Phase.GREETING, _ACCEPT),
    greetings.Rejected: Rule(Phase.GREETING, _ACCEPT),
    messages.DescribeVolume: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.VolumeDescribed: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,), Payload(_description_bytes, LARGEST_HISTOGRAMS)),
    messages.ReadSubCubes: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.SubCubesRead: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.LendVolume: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.VolumeLent: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.ReadPart: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.PartRead: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,), Payload(_part_bytes, LARGEST_PART)),
    messages.AwaitParts: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.HoldPart: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,), Payload(_part_bytes, LARGEST_PART)),
    messages.PartHeld: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.CountHistograms: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.HistogramsCounted: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,), Payload(_histogram_bytes, LARGEST_HISTOGRAMS)),
    messages.PackVoxels: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.VoxelsPacked: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.DescribeMachine: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.MachineDescribed: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.OpenPackets: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.InviteWorkers: Rule(Phase.OPEN, (CLIENT_TO_SPLAT,)),
    messages.ConnectToSplatServers: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.ConnectedToSplatServers: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.RenderFrame: Rule(Phase.OPEN, _TO_SERVERS),
    messages.AbortFrame: Rule(Phase.OPEN, _TO_SERVERS),
    messages.FrameAborted: Rule(Phase.OPEN, _FROM_SERVERS),
    messages.FrameMapped: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.FrameFinished: Rule(Phase.OPEN, (SPLAT_TO_CLIENT,)),
    messages.ReadImage: Rule(Phase.OPEN, (CLIENT_TO_SPLAT,)),
    messages.ImageRead: Rule(Phase.OPEN, (SPLAT_TO_CLIENT,), Payload(_image_bytes, LARGEST_IMAGE)),
    messages.Batch: Rule(Phase.OPEN, (DATA_LINK_TO_SPLAT,), Payload(_batch_bytes, LARGEST_BATCH)),
    messages.TilesClosed: Rule(Phase.OPEN, (SPLAT_TO_DATA_LINK,), Payload(_tiles_bytes, LARGEST_TILE_MAP)),
    messages.ProbeVoxels: Rule(Phase.OPEN, (CLIENT_TO_MAPSHADE,)),
    messages.VoxelProbed: Rule(Phase.OPEN, (MAPSHADE_TO_CLIENT,)),
    messages.Refused: Rule(Phase.OPEN, _FROM_SERVERS),
    messages.EndSession: Rule(Phase.OPEN, _TO_SERVERS, ends=True),
}

LARGEST_PAYLOAD = max(rule.payload.limit for rule in RULES.values() if rule.payload)


class Speech:
    """What may be said in one direction of a connection, from now on. Sender and receiver each keep one."""

    def __init__(self, way: Way | None = None, server: int = 0, exchanges: Exchanges | None = None) -> None:
        """`way` is None during the handshake. `server`: where not 0, the only worker that batches may name.

        `exchanges` are those of the connection, shared by both directions; None on a data link, where nobody asks.
        """
        self.way = way
        self.server = server
        self._exchanges = exchanges
        self.phase = Phase.GREETING if way is None else Phase.OPEN

    def payload_bytes(self, message: Message) -> int:
        """The length that the message announces. Raises ValueError where it is out of place or announces too much."""
        name, rule = type(message).__name__, RULES[type(message)]
        if self.phase != rule.phase:
            raise ValueError(f"{name} came in phase {self.phase.value}, but it belongs to phase {rule.phase.value}")
        if self.way is not None and self.way not in rule.ways:
            raise ValueError(f"{name} came from {self.way}, but it goes from {' or '.join(map(str, rule.ways))}")
        if isinstance(message, Batch) and self.server not in (0, message.worker):
            raise ValueError(f"Batch.worker is {message.worker}, but this data link is of worker {self.server}")
        if self._exchanges is not None:
            self._exchanges.check(message)
        if rule.payload is None:
            return 0
        announced = rule.payload.announced(message)
        if announced > rule.payload.limit:
            raise ValueError(f"{name} announces {announced} bytes, but its limit is {rule.payload.limit}")
        return announced

    def said(self, message: Message) -> None:
        """The message is over: move on."""
        if self._exchanges is not None:
            self._exchanges.said(message)
        if RULES[type(message)].ends:
            self.phase = Phase.ENDED


_ENCODER = msgspec.msgpack.Encoder()
_DECODERS: dict[Phase, msgspec.msgpack.Decoder[Message]] = {
    phase: msgspec.msgpack.Decoder(Union[tuple(kind for kind, rule in RULES.items() if rule.phase == phase)])  # noqa: UP007
    for phase in (Phase.GREETING, Phase.OPEN)
}
_DECODERS[Phase.ENDED] = _DECODERS[Phase.OPEN]


def encode_control(message: Message) -> bytes:
    """The message as msgpack. Raises LocalProtocolError for a field that msgpack cannot carry."""
    try:
        return _ENCODER.encode(message)
    except (TypeError, ValueError, OverflowError) as error:
        raise LocalProtocolError(f"{type(message).__name__} cannot be sent: {error}") from error


def decode_control(control: bytes | bytearray | memoryview, phase: Phase) -> Message:
    """The message that `control` holds. Raises RemoteProtocolError naming the field, its value and its limit."""
    try:
        return _DECODERS[phase].decode(control)
    except (msgspec.DecodeError, ValueError, ArithmeticError, RecursionError) as error:
        raise RemoteProtocolError(f"the control part cannot be read: {_told(error, control)}") from error


def _told(error: Exception, control: bytes | bytearray | memoryview) -> str:
    """The error in one line, with the offending value where msgspec gives its place."""
    text = printable(" ".join(str(error).split()))
    place = re.search(r" - at `\$((?:\.\w+|\[\d+\])+)`$", text)
    if place is None:
        return text
    try:
        value = msgspec.msgpack.decode(control)
        for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place[1]):
            value = value[key] if key else value[int(index)]
    except (msgspec.DecodeError, ValueError, LookupError, TypeError, RecursionError):
        return text
    return f"{text}, which is {ascii(value)[:80]}"
