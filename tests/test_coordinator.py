"""The coordinator as a state machine: events in, instructions out, no socket and no clock."""

from array import array
from itertools import permutations

import msgspec
import pytest

from volsplat.client.coordinator import Coordinator, Phase
from volsplat.client.coordinator_events import (
    AbortAsked,
    EndFrame,
    Event,
    FailSession,
    FrameAsked,
    Instruction,
    MessageReceived,
    PartialImageAsked,
    PublishImage,
    PublishVolume,
    Send,
    ServerJoined,
    ServerLost,
    ServerProcessEnded,
    VolumeAsked,
)
from volsplat.client.presets import preset_scene
from volsplat.protocol import messages
from volsplat.protocol.addresses import Address
from volsplat.protocol.errors import BadInput, PeerLost
from volsplat.protocol.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.roles import Role
from volsplat.protocol.scene import TRAVERSAL_ORDERS, Bounds, Order, Quantise, Scene, Step
from volsplat.protocol.volume import Geometry, VolumeDescription

SPLAT, FIRST, SECOND = 1, 2, 3
DATA = Address("127.0.0.1", 4000)
JOINS: list[Event] = [
    ServerJoined(SPLAT, Role.SPLAT_SERVER, "splat server 1", DATA),
    ServerJoined(FIRST, Role.MAPSHADE_SERVER, "map/shade server 2", Address("", 0)),
    ServerJoined(SECOND, Role.MAPSHADE_SERVER, "map/shade server 3", Address("", 0)),
]
ASKED = VolumeAsked("/volumes/head.nrrd", workers=2)
SCENE = preset_scene("ct-skin")
DESCRIPTION = VolumeDescription(name="head", format="NRRD", geometry=Geometry(dims=(8, 9, 10)), scalar_type="uint16")
SPLAT_STATS = messages.SplatStats(1, 0, 8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, {}, 1)
MAP_STATS = messages.MapShadeStats(1, 1, 1, 8, 0.0, 0.0, 0.0, 0.0, 1)


def said(server: int, message: messages.Message, payload: bytes = b"") -> MessageReceived:
    return MessageReceived(server, message, memoryview(payload), at=0.0)


def sent(instructions: list[Instruction]) -> list[tuple[int, type]]:
    return [(i.server, type(i.message)) for i in instructions if isinstance(i, Send)]


def counted(server: int) -> MessageReceived:
    counts = array("q", bytes(8 * HISTOGRAM_BINS))
    counts[7] = 360
    return said(server, messages.HistogramsCounted(1, HISTOGRAM_BINS), counts.tobytes() * 2)


def surveyed() -> Coordinator:
    coordinator = Coordinator()
    for event in [*JOINS, ASKED, said(FIRST, messages.VolumeDescribed(DESCRIPTION))]:
        coordinator.handle(event)
    for server, low, high in ((FIRST, 0.0, 50.0), (SECOND, -3.0, 20.0)):
        survey = Survey(low=low, high=high, max_gradient=high, voxels=360, no_data=1)
        coordinator.handle(said(server, messages.SubCubesRead(1, survey, 720, 0.1)))
    coordinator.handle(counted(FIRST))
    published = coordinator.handle(counted(SECOND))
    assert any(isinstance(i, PublishVolume) for i in published)
    return coordinator


def packed(coordinator: Coordinator, assignment: int = 1) -> list[Instruction]:
    instructions: list[Instruction] = []
    for server in (FIRST, SECOND):
        instructions = coordinator.handle(said(server, messages.VoxelsPacked(assignment, 360, 1440, 0.1)))
    return instructions


def drawing(frame: int = 1, scene: Scene = SCENE) -> Coordinator:
    coordinator = surveyed()
    coordinator.handle(FrameAsked(frame, scene, Step.F))
    packed(coordinator)
    return coordinator


@pytest.mark.parametrize("order", list(permutations([*JOINS, ASKED])))
def test_servers_may_join_in_any_order(order: list[Event]) -> None:
    coordinator = Coordinator()
    instructions: list[Instruction] = []
    for event in order:
        assert sent(instructions) == []
        instructions = coordinator.handle(event)
    assert sent(instructions) == [(FIRST, messages.DescribeVolume)]


def test_the_surveys_of_all_sub_cubes_become_one() -> None:
    volume = surveyed().volume
    assert volume is not None
    assert (volume.survey.low, volume.survey.high, volume.survey.max_gradient) == (-3.0, 50.0, 50.0)
    assert (volume.survey.voxels, volume.survey.no_data) == (720, 2)
    assert volume.density_counts[7] == volume.strength_counts[7] == 720


def test_a_frame_waits_until_the_voxels_are_packed_and_goes_to_the_splat_server_first() -> None:
    coordinator = surveyed()
    asked = coordinator.handle(FrameAsked(1, SCENE, Step.A))
    assert sent(asked) == [(FIRST, messages.PackVoxels), (SECOND, messages.PackVoxels)]
    assert sent(packed(coordinator)) == [
        (SPLAT, messages.RenderFrame),
        (FIRST, messages.RenderFrame),
        (SECOND, messages.RenderFrame),
    ]


FINISHED, IMAGE = 2, 3  # the splat server sends the complete image only after it finished


@pytest.mark.parametrize("order", [p for p in permutations(range(4)) if p.index(FINISHED) < p.index(IMAGE)])
def test_an_image_is_published_once_it_and_every_report_are_here(order: tuple[int, ...]) -> None:
    coordinator = drawing()
    answers = [
        said(FIRST, messages.FrameMapped(1, MAP_STATS)),
        said(SECOND, messages.FrameMapped(1, MAP_STATS)),
        said(SPLAT, messages.FrameFinished(1, True, [], SPLAT_STATS)),
        said(SPLAT, messages.ImageRead(1, Step.F, True, 1, 1), bytes(16)),
    ]
    last: list[Instruction] = []
    for n in order:
        assert not any(isinstance(i, PublishImage) for i in last)
        last = coordinator.handle(answers[n])
    (image,) = [i for i in last if isinstance(i, PublishImage)]
    assert image.complete and image.outcome is not None and set(image.outcome.map_shade) == {FIRST, SECOND}
    assert coordinator.frame is None


def test_servers_are_told_an_order_and_need_not_choose() -> None:
    coordinator = surveyed()
    coordinator.handle(FrameAsked(1, msgspec.structs.replace(SCENE, order=Order.FASTEST), Step.F))
    told = [i.message for i in packed(coordinator) if isinstance(i, Send)]
    orders = {message.scene.order for message in told if isinstance(message, messages.RenderFrame)}
    assert len(orders) == 1 and orders <= set(TRAVERSAL_ORDERS)


def test_a_newer_frame_ends_the_older_one_and_nothing_of_it_is_published() -> None:
    coordinator = drawing()
    newer = coordinator.handle(FrameAsked(2, SCENE, Step.F))
    assert EndFrame(1) in newer
    assert (SPLAT, messages.RenderFrame) in sent(newer)
    late = coordinator.handle(said(SPLAT, messages.ImageRead(1, Step.F, True, 1, 1), bytes(16)))
    assert late == []


def test_an_aborted_frame_ends_when_every_server_has_acknowledged() -> None:
    coordinator = drawing()
    asked = coordinator.handle(AbortAsked(1))
    assert sent(asked) == [(n, messages.AbortFrame) for n in (SPLAT, FIRST, SECOND)]
    assert coordinator.handle(said(FIRST, messages.FrameAborted(1))) == []
    assert coordinator.handle(said(SPLAT, messages.FrameAborted(1))) == []
    assert coordinator.handle(said(SECOND, messages.FrameAborted(1))) == [EndFrame(1)]


def test_partial_images_are_asked_for_only_while_the_frame_is_drawn() -> None:
    coordinator = drawing()
    assert sent(coordinator.handle(PartialImageAsked(1))) == [(SPLAT, messages.ReadImage)]
    assert coordinator.handle(PartialImageAsked(7)) == []
    coordinator.handle(AbortAsked(1))
    assert coordinator.handle(PartialImageAsked(1)) == []


def test_another_window_makes_the_servers_read_and_pack_again() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    assert sent(coordinator.handle(FrameAsked(2, narrow, Step.F)))[-2:] == [
        (FIRST, messages.ReadSubCubes),
        (SECOND, messages.ReadSubCubes),
    ]
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=360, no_data=0)
    coordinator.handle(said(FIRST, messages.SubCubesRead(2, survey, 720, 0.1)))
    read = coordinator.handle(said(SECOND, messages.SubCubesRead(2, survey, 720, 0.1)))
    assert (FIRST, messages.PackVoxels) in sent(read)
    (render, *_) = [i.message for i in packed(coordinator, 2) if isinstance(i, Send)]
    assert isinstance(render, messages.RenderFrame) and render.quantisation.window == (0.0, 9.0)


@pytest.mark.parametrize("server", [SPLAT, FIRST, SECOND])
def test_a_lost_server_that_draws_fails_the_frame_and_the_session(server: int) -> None:
    coordinator = drawing()
    ended, failed = coordinator.handle(ServerLost(server, f"server {server} is gone"))
    assert isinstance(ended, EndFrame) and isinstance(ended.error, PeerLost) and ended.frame == 1
    assert isinstance(failed, FailSession) and f"server {server} is gone" == str(failed.error)
    (again,) = coordinator.handle(FrameAsked(2, SCENE, Step.F))
    assert isinstance(again, EndFrame) and again.error is failed.error


def test_a_server_that_joins_late_or_leaves_idle_changes_nothing() -> None:
    coordinator = drawing()
    late = ServerJoined(4, Role.MAPSHADE_SERVER, "map/shade server 4", Address("", 0))
    assert coordinator.handle(late) == []
    assert coordinator.handle(ServerLost(4, "left")) == []
    assert coordinator.phase == Phase.READY


def test_a_process_that_ends_before_it_joined_fails_the_session() -> None:
    coordinator = Coordinator()
    coordinator.handle(ASKED)
    (failed,) = coordinator.handle(ServerProcessEnded("the splat server ended with status 1"))
    assert isinstance(failed, FailSession)


def test_what_a_server_refuses_is_bad_input_with_its_cause() -> None:
    coordinator = Coordinator()
    for event in [*JOINS, ASKED]:
        coordinator.handle(event)
    (failed,) = coordinator.handle(said(FIRST, messages.Refused("DescribeVolume", "head.nrrd: truncated")))
    assert isinstance(failed, FailSession) and isinstance(failed.error, BadInput)
    assert str(failed.error) == "head.nrrd: truncated"


def test_bounds_outside_the_volume_end_the_frame_but_not_the_session() -> None:
    coordinator = drawing()
    outside = Scene(tables=SCENE.tables, bounds=Bounds(low=(0, 0, 0), high=(9, 9, 9)))
    (*_, ended) = coordinator.handle(FrameAsked(2, outside, Step.F))
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput) and "bounds on i" in str(ended.error)
    assert (SPLAT, messages.RenderFrame) in sent(coordinator.handle(FrameAsked(3, SCENE, Step.F)))


@pytest.mark.parametrize("server", [SPLAT, FIRST, SECOND])
def test_a_server_that_is_lost_while_the_volume_is_described_fails_the_session(server: int) -> None:
    coordinator = Coordinator()
    for event in [*JOINS, ASKED]:
        coordinator.handle(event)
    (failed,) = coordinator.handle(ServerLost(server, "it is gone"))
    assert isinstance(failed, FailSession)


def test_an_idle_splat_server_may_leave() -> None:
    coordinator = drawing()
    coordinator.handle(ServerJoined(9, Role.SPLAT_SERVER, "splat server 9", DATA))
    assert coordinator.handle(ServerLost(9, "left")) == []


def test_a_frame_that_must_wait_stops_the_running_one_at_once() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    asked = coordinator.handle(FrameAsked(2, narrow, Step.F))
    assert sent(asked)[:3] == [(n, messages.AbortFrame) for n in (SPLAT, FIRST, SECOND)]
    assert EndFrame(1) in asked


def test_a_refused_frame_ends_alone_and_is_aborted_everywhere() -> None:
    coordinator = drawing()
    *aborts, ended = coordinator.handle(said(SPLAT, messages.Refused("RenderFrame", "no memory", frame=1)))
    assert sent(aborts) == [(n, messages.AbortFrame) for n in (SPLAT, FIRST, SECOND)]
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput)
    assert (SPLAT, messages.RenderFrame) in sent(coordinator.handle(FrameAsked(2, SCENE, Step.F)))


def test_answers_of_an_older_assignment_count_for_nothing() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    coordinator.handle(FrameAsked(2, narrow, Step.F))
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=360, no_data=0)
    for server in (FIRST, SECOND):
        assert coordinator.handle(said(server, messages.SubCubesRead(1, survey, 720, 0.1))) == []
    assert coordinator.phase == Phase.READING
