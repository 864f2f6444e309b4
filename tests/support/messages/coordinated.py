"""A coordinator brought to each stage of its work by the events that lead there."""

from array import array
from dataclasses import replace

import msgspec

from support.messages.message_samples import IDENTITY
from volsplat.client.coordinator.coordinator import Coordinator
from volsplat.client.coordinator.events.events import Event, FrameAsked, MessageReceived, ServerJoined, VolumeAsked
from volsplat.client.coordinator.events.instructions import Instruction, PublishVolume, Send
from volsplat.client.scene.presets import preset_scene
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Quantisation, Survey
from volsplat.protocol.rules.levels import Prepared
from volsplat.protocol.wire.addresses import Address

SPLAT, FIRST, SECOND = 1, 2, 3
DATA = Address("node1", 4000)
NO_DATA = Address("", 0)
JOINED = [
    ServerJoined(SPLAT, Role.SPLAT_SERVER, "splat server 1", "node1", DATA),
    ServerJoined(FIRST, Role.MAPSHADE_SERVER, "map/shade server 2", "node2", NO_DATA),
    ServerJoined(SECOND, Role.MAPSHADE_SERVER, "map/shade server 3", "node3", NO_DATA),
]
MORE_SPLAT_SERVERS = [
    ServerJoined(number, Role.SPLAT_SERVER, f"splat server {number}", f"node{number}", DATA) for number in (8, 9)
]
MEMORY = 1 << 40
ASKED = VolumeAsked("/volumes/head.nrrd", workers=2)
SCENE = msgspec.structs.replace(preset_scene("ct-skin"), image=Image(width=1, height=1))
DESCRIPTION = VolumeDescription(name="head", format="NRRD", geometry=Geometry(dims=(8, 9, 10)), scalar_type="uint16")
SPLAT_STATS = messages.SplatStats(1, 0, 8, 0.0, 0.0, 0.0, 0.0, 0.0, {}, 0.0, [1], 1, this_machine())
MAP_STATS = messages.MapShadeStats(1, 1, 1, 8, 8, 0.0, 0.0, 0.0, 0.0, 0.0, 1, this_machine())


class CheckedCoordinator(Coordinator):
    """Its invariants hold after every event."""

    def handle(self, event: Event) -> list[Instruction]:
        told = super().handle(event)
        self.validate_state()
        return told


def joins(*joined: ServerJoined, memory: int = MEMORY) -> list[Event]:
    """These servers join, and tell what they have."""
    machine = messages.MachineDescribed(memory, threads=1)
    return [event for one in joined for event in (one, said(one.server, machine))]


def said(server: int, message: messages.Message, payload: bytes = b"") -> MessageReceived:
    return MessageReceived(server, message, memoryview(payload), at=0.0)


def sent(instructions: list[Instruction]) -> list[tuple[int, type]]:
    return [(i.server, type(i.message)) for i in instructions if isinstance(i, Send)]


def counted(server: int, voxels: int = 360) -> MessageReceived:
    counts = array("q", bytes(8 * HISTOGRAM_BINS))
    counts[7] = voxels
    extremes = BlockExtremes.nothing(DESCRIPTION.geometry.dims)
    message = messages.HistogramsCounted(1, HISTOGRAM_BINS, len(extremes.least))
    return said(server, message, counts.tobytes() * 2 + extremes.as_bytes())


def read_by(coordinator: CheckedCoordinator, server: int) -> MessageReceived:
    """What a server says once it has read what it is to hold."""
    voxels = sum(box.voxels for box in coordinator.holding.boxes[server])
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=voxels, no_data=0)
    return said(server, messages.SubCubesRead(coordinator.holding.assignment, survey, 0.1))


def surveyed(splat_servers: int = 1) -> CheckedCoordinator:
    coordinator = CheckedCoordinator()
    asked = replace(ASKED, splat_servers=splat_servers)
    joined = [*JOINED, *MORE_SPLAT_SERVERS[: splat_servers - 1]]
    for event in [*joins(*joined), asked, said(FIRST, messages.VolumeDescribed(DESCRIPTION, None, IDENTITY))]:
        coordinator.handle(event)
    for server, low, high in ((FIRST, 0.0, 50.0), (SECOND, -3.0, 20.0)):
        survey = Survey(low=low, high=high, max_gradient=high, voxels=360, no_data=1)
        coordinator.handle(said(server, messages.SubCubesRead(1, survey, 0.1)))
    coordinator.handle(counted(FIRST))
    published = coordinator.handle(counted(SECOND))
    assert any(isinstance(i, PublishVolume) for i in published)
    return coordinator


def packed(coordinator: CheckedCoordinator, assignment: int = 1) -> list[Instruction]:
    instructions: list[Instruction] = []
    for server in (FIRST, SECOND):
        instructions = coordinator.handle(said(server, messages.VoxelsPacked(assignment, 0, 0.1)))
    return instructions


def drawing(frame: int = 1, scene: Scene = SCENE, splat_servers: int = 1) -> CheckedCoordinator:
    coordinator = surveyed(splat_servers)
    coordinator.handle(FrameAsked(frame, scene, Step.F, require_complete=True))
    packed(coordinator)
    return coordinator


WHOLE = msgspec.structs.replace(DESCRIPTION, reads_sub_cubes=False, why_whole="it is compressed")
THIRD = 4
LENT = messages.VolumeLent(1, ["uint16"])


def lending(workers: int = 3) -> CheckedCoordinator:
    coordinator = CheckedCoordinator()
    third = ServerJoined(THIRD, Role.MAPSHADE_SERVER, "map/shade server 4", "node4", NO_DATA)
    for event in [*joins(*JOINED, third), VolumeAsked("/volumes/head.nrrd", workers=workers)]:
        coordinator.handle(event)
    asked = sent(coordinator.handle(said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY))))
    assert asked[0] == (SPLAT, messages.InviteWorkers), "before any of them links to it"
    assert [ask for ask in asked[1:] if ask[1] is not messages.ConnectToSplatServers] == [(FIRST, messages.LendVolume)]
    return coordinator


CUBE = Geometry(dims=(64, 64, 64))
GRIDS = tuple(
    Geometry((64 // f, 64 // f, 64 // f), ((f, 0.0, 0.0), (0.0, f, 0.0), (0.0, 0.0, f)), ((f - 1) / 2,) * 3)
    for f in (1, 2, 4)
)
PREPARED = Prepared(
    Survey(low=0.0, high=9.0, max_gradient=4.0, voxels=64**3, no_data=0), Quantisation((0.0, 9.0), 60.0), GRIDS
)


def opened_store(memory: int | None = None, has: int = MEMORY) -> CheckedCoordinator:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED, memory=has), VolumeAsked("/volumes/head.zarr", workers=2, memory=memory)]:
        coordinator.handle(event)
    described = messages.VolumeDescribed(msgspec.structs.replace(DESCRIPTION, geometry=CUBE), PREPARED, IDENTITY)
    extremes = BlockExtremes.nothing(CUBE.dims).as_bytes()
    told = coordinator.handle(said(FIRST, described, bytes(16 * HISTOGRAM_BINS) + extremes))
    assert isinstance(told[-1], PublishVolume)
    return coordinator
