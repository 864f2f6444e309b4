"""One fixed sample of every message, and strategies that draw any; the samples' bytes are kept in tests/recorded.

`python -m support.messages.message_samples` records what is not recorded yet; a record is never overwritten.
"""

import struct
from typing import Any

from hypothesis import strategies as st

from support.checkout import ROOT
from support.messages.protocol_schema import schema_hash
from support.scenes.arbitrary import geometries, situations
from support.scenes.scenes import scenes
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, Geometry, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.messages import greetings, messages
from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.messages import Message
from volsplat.protocol.messages.roles import Role, Way
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.messages.versions import SPOKEN
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import Quantisation, Survey
from volsplat.protocol.rules.levels import Prepared
from volsplat.protocol.rules.light_blocks import LightBlocks
from volsplat.protocol.rules.line_of_sight import line_of_sight, sight_plan
from volsplat.protocol.rules.packet_layout import ROW_RUN
from volsplat.protocol.rules.regions import Rectangle, Region
from volsplat.protocol.rules.shading_rule import shading_rule
from volsplat.protocol.rules.slice_plane import SlicePlane
from volsplat.protocol.wire.framing import HEADER, MAGIC

RECORDED = ROOT / "tests" / "recorded" / f"protocol-{SPOKEN.newest}"
SCHEMA = RECORDED / "schema.sha256"

GEOMETRY = Geometry((4, 5, 6), ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 2.0)), (1.0, -2.0, 3.0))
DESCRIPTION = VolumeDescription(
    name="head",
    format="NRRD",
    geometry=GEOMETRY,
    scalar_type="int16",
    unit="mm",
    anatomical=True,
    kind=Kind.LABELS,
    kind_from="the segments in its header",
    bands=(Band("bone", 1.0, 1.0, (1.0, 0.5, 0.25)), Band("air", 2.0, 4.0)),
)
IDENTITY = VolumeIdentity(size=352, header="0f" * 16, contents="1e" * 16, times="2d" * 16, place="3c" * 16)
ENTRIES = [
    messages.FolderEntry("scans", "", "folder", 0, is_folder=True, is_volume=False),
    messages.FolderEntry("", "4", "series 4 “T2 AX”, 24 slices of 256 x 256", 0, is_folder=False, is_volume=True),
    messages.FolderEntry("head.nrrd", "", "NRRD", 352, is_folder=False, is_volume=True),
]
BOXES = [Box((0, 0, 0), (4, 5, 3)), Box((0, 0, 3), (4, 5, 6))]
QUANTISATION = Quantisation(window=(-1000.0, 2000.0), strength_scale=0.25)
SCENE = Scene(
    tables=Tables(
        emit=ColourTable(points=((0.0, (1.0, 0.5, 0.25)),)),
        refl=ColourTable(points=((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0)))),
        opac=ScalarTable(points=((0.25, 0.0), (0.5, 1.0))),
    )
)
PLAN, SHADING = plan_frame(SCENE, GEOMETRY, Step.F), shading_rule(SCENE, Step.F)
IN_SLABS = plan_frame(SCENE, GEOMETRY, Step.G)
PLANE = SlicePlane(GEOMETRY.dims, 2, 3)
LINE = line_of_sight(SCENE, GEOMETRY, 12.5, 7.25)
DRAWING = Drawing(PLAN, SHADING, GEOMETRY, QUANTISATION, 0)
REGIONS = [Region(3, 0, 0), Region(3, 0, 256), Region(4, 256, PLAN.height)]
PART = messages.VolumePart(server=2, sub_cube=0, scalar=0, scalar_type="int16", box=Box((0, 1, 3), (4, 2, 4)))
MACHINE = Machine("node-1", "Linux", "a processor", 8)
LINK_STATS = messages.LinkStats(2000, 900, 0.375, 0.25)
SLAB_STAGES = messages.SlabStages(0.75, 0.25, 0.375, 0.0625)
SPLAT_STATS = messages.SplatStats(
    100, 40, 900, 2.5, 0.125, 0.5, 1.5, 0.25, {1: 0.125, 2: 0.0}, 0.25, [5, 0, 7], 1 << 30, MACHINE, SLAB_STAGES
)

SAMPLES: dict[type[Message], tuple[Message, bytes]] = {
    type(message): (message, payload)
    for message, payload in (
        (greetings.Hello(Role.SPLAT_SERVER, 1, 1, bytes(range(32)), 0, "node7", 7001, "node7, process 12"), b""),
        (greetings.Challenge(Role.CLIENT, 1, 1, bytes(range(32, 64))), b""),
        (greetings.Proof(bytes(range(64, 96))), b""),
        (greetings.Welcome(3, bytes(range(96, 128))), b""),
        (greetings.Rejected("no thread", passing=True), b""),
        (messages.DescribeVolume("/data/head.nrrd"), b""),
        (messages.VolumeDescribed(DESCRIPTION, None, IDENTITY), b""),
        (messages.ReadSubCubes(1, "/data/head.nrrd", BOXES, IDENTITY), b""),
        (messages.SubCubesRead(1, Survey(-1000.0, 3000.0, 512.5, 120, 2), 0.125), b""),
        (messages.LendVolume(1, "/data/head.nrrd", IDENTITY), b""),
        (messages.VolumeLent(1, ["int16"]), b""),
        (messages.ReadPart(1, PART), b""),
        (messages.PartRead(1, PART), struct.pack("<4h", -1000, 0, 40, 3000)),
        (messages.AwaitParts(1, DESCRIPTION, [Box((0, 0, 3), (4, 5, 6))]), b""),
        (messages.HoldPart(1, PART), struct.pack("<4h", -1000, 0, 40, 3000)),
        (messages.PartHeld(1), b""),
        (messages.CountHistograms(1, -1000.0, 3000.0, 512.5), b""),
        (messages.HistogramsCounted(1, 2, 1), struct.pack("<4q2d", 100, 18, 60, 58, -1000.0, 3000.0)),
        (messages.PackVoxels(1, QUANTISATION), b""),
        (messages.VoxelsPacked(1, 48, 0.0625), b""),
        (messages.ChangeSubCubes(2, "/data/head.nrrd", BOXES, IDENTITY, QUANTISATION), b""),
        (messages.ReadAhead(1, "/data/head.nrrd", BOXES, IDENTITY, QUANTISATION), b""),
        (messages.AheadRead(1), b""),
        (messages.ReadVoxel(5, "/data/head.nrrd", IDENTITY, (3, 2, 1)), b""),
        (messages.VoxelRead(5, ["int16", "float32"]), struct.pack("<hf", -8882, 0.5)),
        (messages.ListFolder(6, "/data", "scans", "t2"), b""),
        (messages.FolderListed(6, ENTRIES, 3), b""),
        (messages.NameSession("1f2e3d4c"), b""),
        (messages.DescribeMachine(), b""),
        (messages.Alive(2.0), b""),
        (messages.LeaveSession(), b""),
        (messages.MachineDescribed(1 << 34, 8), b""),
        (messages.MeasureLink(3, 5), b"any"),
        (messages.LinkMeasured(5), b"bytes"),
        (messages.OpenPackets(2, "/data/head.zarr", [messages.LevelBoxes(1, BOXES[:1])], IDENTITY), b""),
        (messages.InviteWorkers({1: bytes(range(32)), 2: bytes(range(32, 64))}), b""),
        (messages.ConnectToSplatServers([messages.Route(3, "127.0.0.1", 7001, bytes(range(32)))]), b""),
        (messages.ConnectedToSplatServers([3]), b""),
        (messages.RenderFrame(7, 1, DRAWING, {1: 1, 2: 4}, REGIONS, True), b""),
        (messages.SumDepths(7, 1, Drawing(IN_SLABS, SHADING, GEOMETRY, QUANTISATION, 0)), b""),
        (messages.DepthsSummed(7, 1, (2, 1, 1)), struct.pack("<2Q", 65536, 7)),
        (messages.ReadClock(), b""),
        (messages.ClockRead(1024.5), b""),
        (messages.ReadTrace(7), b""),
        (messages.FrameTraced(7, [messages.Span("walker 0", "walk", 1024.5, 1024.75)], 1), b""),
        (messages.AbortFrame(7), b""),
        (messages.FrameAborted(7), b""),
        (
            messages.FrameMapped(
                7,
                messages.MapShadeStats(
                    120, 100, 2, 2000, 900, 0.125, 0.5, 0.25, 0.375, 0.25, 1 << 29, MACHINE, {3: LINK_STATS}
                ),
                [3],
            ),
            b"",
        ),
        (messages.FrameFinished(7, False, [2], SPLAT_STATS), b""),
        (messages.ReadProgress(7), b""),
        (messages.FrameProgress(7, 0.375), b""),
        (messages.ReadImage(7), b""),
        (
            messages.ImageRead(7, Step.C, True, 0, 4, 2, 1, messages.RawPixels()),
            struct.pack("<8f", 0, 0.25, 0.5, 1, 1, 0.5, 0.25, 0),
        ),
        (messages.ImagesTaken(7000, 0.125, 0.25, 1, [0, 0, 3]), b""),
        (
            messages.Batch(7, 2, 1, 0, 0, [messages.BatchPart(0, 0), messages.BatchPart(1, 2)], 4, 3, True),
            ROW_RUN.pack(4, 2, 1, 2, -64, 64) + struct.pack("<2Q", 0xFF80403FFF000040, 0x0102030014000041),
        ),
        (messages.ChannelsShared(3, 4, 1 << 21), b""),
        (messages.MergeReached(7, 5, 12), b""),
        (messages.TilesClosed(7, 260, 4, 9), struct.pack("<4Q", 1 << 63 | 5, 1, 0, 0)),
        (messages.ProbeVoxels(5, 1, LINE, Drawing.of(SCENE, sight_plan(SCENE, GEOMETRY), GEOMETRY, QUANTISATION)), b""),
        (messages.VoxelProbed(5, messages.ProbedVoxel((1, 2, 3), -12.0, 0.5)), b""),
        (messages.ReadSlice(6, 1, PLANE, DRAWING), b""),
        (messages.SliceRead(6, 1, [Rectangle(0, 1, 2, 1)]), struct.pack("<2I8B", 1 << 31, 7, *range(8))),
        (messages.CountPlane(8, 1, 0), b""),
        (messages.PlaneCounted(8, 1), struct.pack("<2Q", 3, 4) + bytes(8 * 65534)),
        (messages.Refused("RenderFrame", "no such assignment", frame=7), b""),
        (messages.EndSession(), b""),
    )
}
UNFORESEEN = messages.HoldPart(1, None)  # type: ignore[arg-type]  # to send it is an error that nobody has foreseen


def speech_for(kind: type[Message]) -> Speech:
    """A connection on which messages of this kind may go."""
    return Speech(kind.ways[0]) if kind.ways else Speech()


def lawful_kinds(way: Way | None) -> list[type[Message]]:
    """What may be said on that way; None is the handshake."""
    if way is None:
        return list(greetings.GREETINGS)
    return [kind for kind in MESSAGES if way in kind.ways]


def framed(control: bytes, payload: bytes = b"", *, control_bytes: int | None = None, payload_bytes: int | None = None,
           magic: int = MAGIC) -> bytes:  # fmt: skip
    """A message's bytes; the header's numbers can be made to lie."""
    return (
        HEADER.pack(
            magic,
            len(control) if control_bytes is None else control_bytes,
            len(payload) if payload_bytes is None else payload_bytes,
        )
        + control
        + payload
    )


def sample_bytes(kind: type[Message]) -> bytes:
    message, payload = SAMPLES[kind]
    return framed(encode_control(message), payload)


ids = st.integers(1, messages.LARGEST_ID)
ids_or_none = st.integers(0, messages.LARGEST_ID)
counts = st.integers(0, messages.LARGEST_COUNT)
ordinals = st.integers(0, 2**32 - 1)
seconds = st.floats(0, 1e9)
finite = st.floats(allow_nan=False)
lines = st.text(max_size=20)
paths = st.text(min_size=1, max_size=20)
blobs = st.binary(min_size=32, max_size=32)
_windows = st.tuples(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6)).map(lambda pair: (pair[0], pair[0] + pair[1]))
quantisations = st.builds(
    Quantisation, window=_windows, strength_scale=st.floats(0, 1e6), strength_low=st.floats(-1e6, 1e6)
)
digests = st.text("0123456789abcdef", min_size=32, max_size=32)
identities = st.builds(VolumeIdentity, size=counts, header=digests, contents=digests, times=digests, place=digests)
surveys = st.builds(Survey, low=finite, high=finite, max_gradient=finite, voxels=counts, no_data=counts)
descriptions = st.builds(
    VolumeDescription,
    name=lines,
    format=lines,
    geometry=geometries(),
    scalar_type=lines,
    unit=lines,
    kind=st.sampled_from(Kind),
    kind_from=lines,
    bands=st.lists(st.builds(Band, lines, st.just(1.0), st.floats(1.0, 9.0)), max_size=3).map(tuple),
    second_scalar=st.none() | st.just((-180.0, 180.0)),
)
_voxel = st.tuples(*[st.integers(0, 100)] * 3)
boxes = st.tuples(_voxel, st.tuples(*[st.integers(1, 100)] * 3)).map(
    lambda pair: Box(pair[0], (pair[0][0] + pair[1][0], pair[0][1] + pair[1][1], pair[0][2] + pair[1][2]))
)
_small_boxes = st.tuples(_voxel, st.tuples(*[st.integers(1, 4)] * 3)).map(
    lambda pair: Box(pair[0], (pair[0][0] + pair[1][0], pair[0][1] + pair[1][1], pair[0][2] + pair[1][2]))
)
_scalar_types = st.sampled_from(sorted(SCALAR_BYTES))
_parts = st.builds(messages.VolumePart, ids, ordinals, st.integers(0, 1), _scalar_types, _small_boxes)
_steps = st.sampled_from(Step)
_plans = st.tuples(situations(), _steps).map(lambda drawn: plan_frame(*drawn[0], drawn[1]))
_slab_plans = situations().map(lambda drawn: plan_frame(*drawn, Step.G))
_level_numbers = st.integers(0, 31)
_rules = (st.builds(shading_rule, scenes(), _steps), geometries(), quantisations, _level_numbers)  # of a Drawing
_prepared = st.builds(Prepared, surveys, quantisations, st.lists(geometries(), min_size=1, max_size=3).map(tuple))
_machines = st.builds(Machine, *[st.text(max_size=20)] * 3, st.integers(1, 64))
_link_stats = st.builds(messages.LinkStats, *[counts] * 2, *[seconds] * 2)
_map_shade_stats = st.builds(
    messages.MapShadeStats,
    *[counts] * 5,
    *[seconds] * 5,
    counts,
    _machines,
    st.dictionaries(ids, _link_stats, max_size=3),
)
_splat_stats = st.builds(
    messages.SplatStats,
    *[counts] * 3,
    *[seconds] * 5,
    st.dictionaries(ids, seconds, max_size=3),
    seconds,
    st.lists(counts, max_size=4),
    counts,
    _machines,
    st.none() | st.builds(messages.SlabStages, *[seconds] * 4),
)
_spans = st.tuples(lines, lines, st.floats(-1e9, 1e9), seconds).map(
    lambda drawn: messages.Span(*drawn[:3], drawn[2] + drawn[3])
)
_versions = st.tuples(st.integers(1, 9), st.integers(1, 9)).map(sorted)


def _greeting(kind: type[Message], *more: st.SearchStrategy[Any]) -> st.SearchStrategy[Message]:
    parts = st.tuples(st.sampled_from(Role), _versions, blobs, *more)
    return parts.map(lambda p: kind(p[0], p[1][0], p[1][1], *p[2:]))


def _part(shape: tuple[int, int]) -> messages.BatchPart:
    return messages.BatchPart(min(shape) if max(shape) else 0, max(shape) if min(shape) else 0)


_batch_parts = st.tuples(st.integers(0, 9), st.integers(0, 9)).map(_part)


_pixels = st.one_of(
    st.just(messages.RawPixels()),
    st.builds(messages.CodedPixels, st.booleans(), st.booleans(), st.just(0), seconds),
    st.builds(messages.SharedPixels, counts, st.integers(0, 9), st.integers(1, 10), st.just(1024), st.just(False)),
)


def _render_frame(plan: FramePlan, cut: int, *others: Any) -> messages.RenderFrame:
    middle = min(cut * TILE_SIDE, plan.height)
    frame, assignment, workers, *drawing = others
    regions = [Region(5, 0, middle), Region(2, middle, plan.height)]
    return messages.RenderFrame(
        frame,
        assignment,
        Drawing(plan, *drawing),
        workers,
        regions,
        cut % 2 == 0,
        light=LightBlocks((9, 8, 7), (2, 1, 3), bytes(range(12)), 0.5, 0.25) if plan.slabs else None,
    )


def _probe_voxels(
    situation: tuple[Scene, Geometry], question: int, assignment: int, x: float, y: float, *rules: Any
) -> messages.ProbeVoxels:
    line, drawing = line_of_sight(*situation, x, y), Drawing(sight_plan(*situation), *rules)
    return messages.ProbeVoxels(question, assignment, line, drawing)


STRATEGIES: dict[type[Message], st.SearchStrategy[Message]] = {
    greetings.Hello: _greeting(greetings.Hello, ids_or_none, lines, st.integers(0, 65535), lines),
    greetings.Challenge: _greeting(greetings.Challenge),
    greetings.Proof: st.builds(greetings.Proof, blobs),
    greetings.Welcome: st.builds(greetings.Welcome, ids, blobs),
    greetings.Rejected: st.builds(greetings.Rejected, lines, st.booleans()),
    messages.DescribeVolume: st.builds(messages.DescribeVolume, paths),
    messages.VolumeDescribed: st.builds(messages.VolumeDescribed, descriptions, st.none() | _prepared, identities),
    messages.ReadSubCubes: st.builds(
        messages.ReadSubCubes, ids, paths, st.lists(boxes, min_size=1, max_size=3), identities
    ),
    messages.SubCubesRead: st.builds(messages.SubCubesRead, ids, surveys, seconds),
    messages.LendVolume: st.builds(messages.LendVolume, ids, paths, identities),
    messages.VolumeLent: st.builds(messages.VolumeLent, ids, st.lists(_scalar_types, min_size=1, max_size=2)),
    messages.ReadPart: st.builds(messages.ReadPart, ids, _parts),
    messages.PartRead: st.builds(messages.PartRead, ids, _parts),
    messages.AwaitParts: st.builds(messages.AwaitParts, ids, descriptions, st.lists(boxes, min_size=1, max_size=3)),
    messages.HoldPart: st.builds(messages.HoldPart, ids, _parts),
    messages.PartHeld: st.builds(messages.PartHeld, ids),
    messages.CountHistograms: st.builds(messages.CountHistograms, ids, finite, finite, finite),
    messages.HistogramsCounted: st.builds(messages.HistogramsCounted, ids, st.integers(1, 40), st.integers(1, 40)),
    messages.PackVoxels: st.builds(messages.PackVoxels, ids, quantisations),
    messages.VoxelsPacked: st.builds(messages.VoxelsPacked, ids, counts, seconds),
    messages.ChangeSubCubes: st.builds(
        messages.ChangeSubCubes, ids, paths, st.lists(boxes, min_size=1, max_size=3), identities, quantisations
    ),
    messages.ReadAhead: st.builds(
        messages.ReadAhead, ids, paths, st.lists(boxes, min_size=1, max_size=3), identities, quantisations
    ),
    messages.AheadRead: st.builds(messages.AheadRead, ids),
    messages.ReadVoxel: st.builds(messages.ReadVoxel, ids, paths, identities, _voxel),
    messages.VoxelRead: st.builds(messages.VoxelRead, ids, st.lists(_scalar_types, max_size=messages.MOST_SCALARS)),
    messages.ListFolder: st.builds(messages.ListFolder, ids, paths, lines, lines),
    messages.FolderListed: st.builds(
        messages.FolderListed,
        ids,
        st.lists(
            st.builds(messages.FolderEntry, lines, lines, lines, counts, st.booleans(), st.booleans()), max_size=3
        ),
        counts,
    ),
    messages.SumDepths: st.builds(messages.SumDepths, ids, ids, st.builds(Drawing, _slab_plans, *_rules)),
    messages.DepthsSummed: st.builds(messages.DepthsSummed, ids, ids, st.tuples(*[st.integers(1, 3)] * 3)),
    messages.NameSession: st.builds(messages.NameSession, lines),
    messages.DescribeMachine: st.builds(messages.DescribeMachine),
    messages.LeaveSession: st.builds(messages.LeaveSession),
    messages.Alive: st.builds(messages.Alive, st.floats(0.5, 86400.0)),
    messages.MachineDescribed: st.builds(messages.MachineDescribed, counts, st.integers(1, messages.MOST_THREADS)),
    messages.MeasureLink: st.builds(messages.MeasureLink, st.integers(0, 64), st.integers(0, 64)),
    messages.LinkMeasured: st.builds(messages.LinkMeasured, st.integers(0, 64)),
    messages.OpenPackets: st.builds(
        messages.OpenPackets,
        ids,
        paths,
        st.lists(
            st.builds(messages.LevelBoxes, st.integers(0, 31), st.lists(boxes, min_size=1, max_size=2)), max_size=3
        ),
        identities,
    ),
    messages.InviteWorkers: st.builds(messages.InviteWorkers, st.dictionaries(ids, blobs, max_size=3)),
    messages.ConnectToSplatServers: st.builds(
        messages.ConnectToSplatServers,
        st.lists(st.builds(messages.Route, ids, lines, st.integers(1, 65535), blobs), max_size=3),
    ),
    messages.ConnectedToSplatServers: st.builds(messages.ConnectedToSplatServers, st.lists(ids, max_size=3)),
    messages.RenderFrame: st.builds(
        _render_frame,
        _plans,
        st.integers(0, 9),
        ids,
        ids,
        st.dictionaries(ids, st.integers(1, 64), max_size=3),
        *_rules,
    ),
    messages.ReadClock: st.builds(messages.ReadClock),
    messages.ClockRead: st.builds(messages.ClockRead, st.floats(-1e12, 1e12)),
    messages.ReadTrace: st.builds(messages.ReadTrace, ids),
    messages.FrameTraced: st.builds(messages.FrameTraced, ids, st.lists(_spans, max_size=3), counts),
    messages.AbortFrame: st.builds(messages.AbortFrame, ids),
    messages.FrameAborted: st.builds(messages.FrameAborted, ids),
    messages.FrameMapped: st.builds(messages.FrameMapped, ids, _map_shade_stats, st.lists(ids, max_size=3)),
    messages.FrameFinished: st.builds(
        messages.FrameFinished, ids, st.booleans(), st.lists(ids, max_size=3), _splat_stats
    ),
    messages.ReadProgress: st.builds(messages.ReadProgress, ids),
    messages.FrameProgress: st.builds(messages.FrameProgress, ids, st.floats(0, 1)),
    messages.ReadImage: st.builds(messages.ReadImage, ids),
    messages.ImageRead: st.builds(
        messages.ImageRead, ids, st.sampled_from(Step), st.booleans(), *[st.integers(0, 8)] * 4, _pixels
    ),
    messages.ImagesTaken: st.builds(
        messages.ImagesTaken, counts, seconds, seconds, counts, st.lists(st.integers(0, 9), max_size=3)
    ),
    messages.ChannelsShared: st.builds(
        messages.ChannelsShared, st.integers(1, 99), st.integers(1, 10), st.integers(1, 1 << 22)
    ),
    messages.Batch: st.builds(
        messages.Batch,
        ids,
        ids,
        st.integers(0, 9),
        counts,
        st.integers(0, 40),
        st.lists(_batch_parts, min_size=1, max_size=3),
        ordinals,
        ordinals,
        st.booleans(),
    ),
    messages.MergeReached: st.builds(messages.MergeReached, ids, st.integers(0, 1 << 31), st.integers(0, 1 << 31)),
    messages.TilesClosed: st.builds(
        messages.TilesClosed, ids, st.integers(1, 600), st.integers(0, 5).map(TILE_SIDE.__mul__), st.integers(20, 40)
    ),
    messages.ProbeVoxels: st.builds(_probe_voxels, situations(), ids, ids, finite, finite, *_rules),
    messages.VoxelProbed: st.builds(
        messages.VoxelProbed,
        ids,
        st.none() | st.builds(messages.ProbedVoxel, _voxel, finite, finite),
    ),
    messages.ReadSlice: st.builds(messages.ReadSlice, ids, ids, st.just(PLANE), st.builds(Drawing, _plans, *_rules)),
    messages.SliceRead: st.builds(
        messages.SliceRead,
        ids,
        ids,
        st.lists(st.builds(Rectangle, *[st.integers(0, 9)] * 2, *[st.integers(1, 9)] * 2), max_size=3),
    ),
    messages.CountPlane: st.builds(messages.CountPlane, ids, ids, _level_numbers),
    messages.PlaneCounted: st.builds(messages.PlaneCounted, ids, ids),
    messages.Refused: st.builds(messages.Refused, lines, lines, st.sampled_from(messages.Reason), *[ids_or_none] * 4),
    messages.EndSession: st.builds(messages.EndSession, st.booleans()),
}


def main() -> None:
    RECORDED.mkdir(parents=True, exist_ok=True)
    for kind in SAMPLES:
        path = RECORDED / f"{kind.__name__}.bin"
        if not path.exists():
            path.write_bytes(sample_bytes(kind))
            print(f"recorded {path.name}")
    if not SCHEMA.exists():
        SCHEMA.write_text(schema_hash() + "\n", encoding="ascii")
        print(f"recorded {SCHEMA.name}")


if __name__ == "__main__":
    main()
