"""The coordinator as a state machine: events in, instructions out, no socket and no clock."""

import math
import struct
from dataclasses import replace
from itertools import permutations

import msgspec
import pytest

from support.messages.coordinated import (
    ASKED,
    DATA,
    FIRST,
    JOINED,
    LENT,
    MAP_STATS,
    MORE_SPLAT_SERVERS,
    NO_DATA,
    SCENE,
    SECOND,
    SPLAT,
    SPLAT_STATS,
    THIRD,
    WHOLE,
    CheckedCoordinator,
    counted,
    drawing,
    joins,
    lending,
    opened_store,
    packed,
    read_by,
    said,
    sent,
    surveyed,
)
from support.messages.message_samples import GEOMETRY, IDENTITY, IN_SLABS, QUANTISATION, REGIONS
from volsplat.client.coordinator.block_depths import BlockDepths
from volsplat.client.coordinator.data_routes import MOST_MADE_ANEW
from volsplat.client.coordinator.events.events import (
    AbortAsked,
    Event,
    FrameAsked,
    MessageReceived,
    NobodyJoined,
    PartialImageAsked,
    PlaneAsked,
    PointAsked,
    ServerJoined,
    ServerLost,
    ServerProcessEnded,
    ServersMissing,
    ServingFailed,
    SliceAsked,
    VolumeAsked,
)
from volsplat.client.coordinator.events.instructions import (
    CutOff,
    EndFrame,
    FailSession,
    GiveAnswer,
    Instruction,
    PublishImage,
    ReportLoss,
    ReportProgress,
    Send,
)
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.client.coordinator.server_states import ImageIncomplete, losses
from volsplat.client.coordinator.servers import KEPT_OUT, LOST_AGAIN, MOST_LOSSES, Servers
from volsplat.client.coordinator.sharing_out import TRIED_AGAIN_AFTER
from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Order, Quantise, Scene, View
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.index_rules import Survey
from volsplat.protocol.rules.light_blocks import light_block_dims
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.text.errors import BadInput, PeerLost


@pytest.mark.parametrize("order", list(permutations([*(joins(one) for one in JOINED), [ASKED]])))
def test_servers_may_join_in_any_order(order: list[list[Event]]) -> None:
    coordinator = CheckedCoordinator()
    instructions: list[Instruction] = []
    for event in [event for events in order for event in events]:
        assert all(kind is messages.DescribeMachine for _, kind in sent(instructions))
        instructions = coordinator.handle(event)
    assert sent(instructions) == [(FIRST, messages.DescribeVolume)]


def test_the_surveys_of_all_sub_cubes_become_one() -> None:
    volume = surveyed().holding.volume
    assert volume is not None
    assert (volume.survey.low, volume.survey.high, volume.survey.max_gradient) == (-3.0, 50.0, 50.0)
    assert (volume.survey.voxels, volume.survey.no_data) == (720, 2)
    assert volume.density_counts[7] == volume.strength_counts[7] == 720


def test_a_frame_waits_until_the_voxels_are_packed_and_goes_to_the_map_shade_servers_first() -> None:
    coordinator = surveyed()
    asked = coordinator.handle(FrameAsked(1, SCENE, Step.A, require_complete=True))
    assert sent(asked) == [(FIRST, messages.PackVoxels), (SECOND, messages.PackVoxels)]
    assert sent(packed(coordinator)) == [
        (FIRST, messages.RenderFrame),
        (SECOND, messages.RenderFrame),
        (SPLAT, messages.RenderFrame),
    ]


FINISHED, IMAGE = 2, 3  # the splat server sends the complete image only after it finished


@pytest.mark.parametrize("order", [p for p in permutations(range(4)) if p.index(FINISHED) < p.index(IMAGE)])
def test_an_image_is_published_once_it_and_every_report_are_here(order: tuple[int, ...]) -> None:
    coordinator = drawing()
    answers = [
        said(FIRST, messages.FrameMapped(1, MAP_STATS, [])),
        said(SECOND, messages.FrameMapped(1, MAP_STATS, [])),
        said(SPLAT, messages.FrameFinished(1, True, [], SPLAT_STATS)),
        said(SPLAT, messages.ImageRead(1, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16)),
    ]
    last: list[Instruction] = []
    for n in order:
        assert not any(isinstance(i, PublishImage) for i in last)
        last = coordinator.handle(answers[n])
    (image,) = [i for i in last if isinstance(i, PublishImage)]
    assert image.complete and image.outcome is not None and set(image.outcome.map_shade) == {FIRST, SECOND}
    assert coordinator.frames.frame is None


def test_servers_are_told_an_order_and_need_not_choose() -> None:
    coordinator = surveyed()
    coordinator.handle(
        FrameAsked(1, msgspec.structs.replace(SCENE, order=Order.FASTEST), Step.F, require_complete=True)
    )
    told = [i.message for i in packed(coordinator) if isinstance(i, Send)]
    orders = {message.drawing.plan.order for message in told if isinstance(message, messages.RenderFrame)}
    assert len(orders) == 1 and orders <= set(TRAVERSAL_ORDERS)


def test_a_newer_frame_ends_the_older_one_and_nothing_of_it_is_published() -> None:
    coordinator = drawing()
    newer = coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=True))
    assert EndFrame(1) in newer
    assert (SPLAT, messages.RenderFrame) in sent(newer)
    late = coordinator.handle(
        said(SPLAT, messages.ImageRead(1, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16))
    )
    assert late == []


def test_a_newer_frame_that_is_heard_of_first_is_drawn_and_the_older_one_is_not() -> None:
    coordinator = drawing(frame=2)
    assert coordinator.handle(FrameAsked(1, SCENE, Step.F, require_complete=True)) == [EndFrame(1)]
    assert coordinator.frames.current(2)


def test_an_aborted_frame_ends_when_every_server_has_acknowledged() -> None:
    coordinator = drawing()
    asked = coordinator.handle(AbortAsked(1))
    assert sent(asked) == [(n, messages.AbortFrame) for n in (FIRST, SECOND, SPLAT)]
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
    assert sent(coordinator.handle(FrameAsked(2, narrow, Step.F, require_complete=True)))[-2:] == [
        (FIRST, messages.ReadSubCubes),
        (SECOND, messages.ReadSubCubes),
    ]
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=360, no_data=0)
    coordinator.handle(said(FIRST, messages.SubCubesRead(2, survey, 0.1)))
    read = coordinator.handle(said(SECOND, messages.SubCubesRead(2, survey, 0.1)))
    assert (FIRST, messages.PackVoxels) in sent(read)
    (render, *_) = [i.message for i in packed(coordinator, 2) if isinstance(i, Send)]
    assert isinstance(render, messages.RenderFrame) and render.drawing.quantisation.window == (0.0, 9.0)


NOBODY = NobodyJoined("the splat server is gone; no other has joined")


def test_a_lost_splat_server_whom_no_other_follows_fails_the_frame_and_the_session() -> None:
    coordinator = drawing()
    lost = coordinator.handle(ServerLost(SPLAT, "the splat server is gone"))
    (ended,) = [one for one in lost if isinstance(one, EndFrame)]
    assert isinstance(ended.error, ImageIncomplete) and ended.frame == 1
    assert not any(isinstance(one, FailSession) for one in lost)
    (failed,) = coordinator.handle(NOBODY)
    assert isinstance(failed, FailSession) and str(failed.error) == NOBODY.cause
    (again,) = coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=False))
    assert isinstance(again, EndFrame) and again.error is failed.error


def test_the_session_has_failed_before_whoever_waits_hears_of_it() -> None:
    """Else they would take it for what one frame ended by."""
    coordinator = drawing()
    assert coordinator.handle(ServerProcessEnded("the splat server ended with status 1")) == []
    failed, ended = coordinator.handle(ServerLost(SPLAT, GONE))
    assert isinstance(failed, FailSession) and isinstance(ended, EndFrame)


def test_a_server_that_leaves_idle_changes_nothing() -> None:
    coordinator = drawing()
    late = ServerJoined(4, Role.MAPSHADE_SERVER, "map/shade server 4", "node4", NO_DATA)
    assert [coordinator.handle(event) for event in joins(late)] == [[Send(4, messages.DescribeMachine())], []]
    assert coordinator.handle(ServerLost(4, "left")) == []
    assert coordinator.holding.phase == Phase.READY


def test_a_process_that_ends_before_it_joined_fails_the_session() -> None:
    coordinator = CheckedCoordinator()
    coordinator.handle(ASKED)
    (failed,) = coordinator.handle(ServerProcessEnded("the splat server ended with status 1"))
    assert isinstance(failed, FailSession)


def test_without_servers_that_are_missing_the_others_begin_where_there_are_both_kinds() -> None:
    coordinator = CheckedCoordinator()
    for event in [ASKED, *joins(JOINED[1])]:
        coordinator.handle(event)
    missing = ServersMissing("node3 does not answer")
    assert coordinator.handle(missing) == []
    for event in joins(JOINED[0]):
        assert (FIRST, messages.DescribeVolume) not in sent(coordinator.handle(event)), "all are waited for"
    told, *begun = coordinator.handle(missing)
    assert told == ReportLoss("node3 does not answer; the others draw without")
    assert (FIRST, messages.DescribeVolume) in sent(begun)
    assert coordinator.handle(missing) == []  # said once


def test_a_session_begins_and_ends_by_nobody_who_has_not_told_yet_what_it_has() -> None:
    coordinator = CheckedCoordinator()
    for event in [replace(ASKED, workers=3), *joins(JOINED[0]), JOINED[1]]:
        coordinator.handle(event)
    for given_up in (True, False):
        missing = ServersMissing("node4 does not answer", given_up=given_up)
        assert coordinator.handle(missing) == [], "it is told again"
    for event in [*joins(JOINED[1])[1:], *joins(JOINED[2])]:
        coordinator.handle(event)
    coordinator.handle(missing)
    assert coordinator.servers.workers == [FIRST, SECOND]


def test_who_is_missing_before_a_volume_is_asked_for_is_not_waited_for_afterwards() -> None:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED[:2]), ServersMissing("node3 does not answer", given_up=True)]:
        coordinator.handle(event)
    assert (FIRST, messages.DescribeVolume) in sent(coordinator.handle(ASKED))


def test_a_session_fails_once_all_of_a_kind_are_given_up() -> None:
    coordinator = CheckedCoordinator()
    for event in [ASKED, *joins(*JOINED[1:])]:
        coordinator.handle(event)
    (failed,) = coordinator.handle(ServersMissing("node1 does not answer", given_up=True))
    assert isinstance(failed, FailSession) and str(failed.error) == "node1 does not answer"


def test_what_a_server_refuses_is_bad_input_with_its_cause() -> None:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED), ASKED]:
        coordinator.handle(event)
    (failed,) = coordinator.handle(said(FIRST, messages.Refused("DescribeVolume", "head.nrrd: truncated")))
    assert isinstance(failed, FailSession) and isinstance(failed.error, BadInput)
    assert str(failed.error) == "head.nrrd: truncated"


def test_what_a_server_of_another_machine_refuses_names_it() -> None:
    coordinator = CheckedCoordinator()
    name = "map/shade server 2 (node1, process 12) at 10.0.0.1:4711"
    far = ServerJoined(FIRST, Role.MAPSHADE_SERVER, name, "10.0.0.1", NO_DATA, elsewhere=True)
    for event in [*joins(JOINED[0], far, JOINED[2]), ASKED]:
        coordinator.handle(event)
    (failed,) = coordinator.handle(said(FIRST, messages.Refused("DescribeVolume", "head.nrrd: truncated")))
    assert isinstance(failed, FailSession) and str(failed.error) == f"{name}: head.nrrd: truncated"


def test_a_worker_that_cannot_reach_the_splat_server_is_lost_and_the_others_draw() -> None:
    coordinator = drawing()
    told = coordinator.handle(said(FIRST, messages.Refused("ConnectToSplatServers", "cannot reach the splat server")))
    assert (FIRST, messages.EndSession) in sent(told) and not any(isinstance(one, FailSession) for one in told)
    assert list(coordinator.holding.boxes) == [SECOND] and coordinator.server_states[FIRST].lost


@pytest.mark.parametrize("other_links", [False, True])
def test_a_worker_that_cannot_reach_the_splat_server_is_lost_before_the_survey_as_well(other_links: bool) -> None:
    """That others take over is said only once one of them has reached it."""
    coordinator = CheckedCoordinator()
    far = replace(JOINED[0], elsewhere=True)
    for event in [*joins(far, *JOINED[1:]), ASKED, said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY))]:
        coordinator.handle(event)
    if other_links:
        coordinator.handle(said(SECOND, messages.ConnectedToSplatServers([SPLAT])))
    refused = messages.Refused(
        "ConnectToSplatServers", "cannot reach the splat server", reason=messages.Reason.PEER_LOST
    )
    told = coordinator.handle(said(FIRST, refused))
    assert (FIRST, messages.EndSession) in sent(told) and not any(isinstance(one, FailSession) for one in told)
    (loss,) = [one.text for one in told if isinstance(one, ReportLoss)]
    assert "--advertise HOST" in loss and ("others take over" in loss) is other_links
    assert list(coordinator.holding.boxes) == [SECOND] and (SECOND, messages.ReadSubCubes) in sent(told)
    if not other_links:
        (failed,) = coordinator.handle(said(SECOND, refused))
        assert isinstance(failed, FailSession) and str(failed.error).startswith(
            "cannot reach the splat server; or tell"
        )


@pytest.mark.parametrize("elsewhere", [False, True])
@pytest.mark.parametrize("reason", messages.Reason)
def test_another_address_is_advised_only_where_dialling_between_machines_failed(
    elsewhere: bool, reason: messages.Reason
) -> None:
    coordinator = CheckedCoordinator()
    splat = replace(JOINED[0], elsewhere=elsewhere)
    described = said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY))
    for event in [*joins(splat, *JOINED[1:]), ASKED, described]:
        coordinator.handle(event)
    refused = messages.Refused("ConnectToSplatServers", "cannot reach it", reason=reason)
    told = [*coordinator.handle(said(FIRST, refused)), *coordinator.handle(said(SECOND, refused))]
    (failed,) = [one for one in told if isinstance(one, FailSession)]
    advised = "--advertise HOST" in str(failed.error)
    assert advised is (elsewhere and reason is messages.Reason.PEER_LOST)


def unlinked() -> tuple[CheckedCoordinator, ServerJoined]:
    """The first worker, of a process of its own, could not link, and is lost; the second one holds all."""
    coordinator = CheckedCoordinator()
    first, second = (replace(one, process=f"process {one.server}") for one in JOINED if one.server != SPLAT)
    assert (first.server, second.server) == (FIRST, SECOND)
    for event in [
        *joins(JOINED[0], first, second),
        ASKED,
        said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY)),
    ]:
        coordinator.handle(event)
    coordinator.handle(
        said(FIRST, messages.Refused("ConnectToSplatServers", "no answer", reason=messages.Reason.PEER_LOST))
    )
    return coordinator, first


def test_a_worker_that_could_not_link_may_try_another_splat_server() -> None:
    """It may have been the one before that was frozen."""
    coordinator, first = unlinked()
    again, splat = replace(first, server=20), replace(JOINED[0], server=21)
    for event in joins(again):
        coordinator.handle(event)
    assert coordinator.servers.idle() == []
    for event in joins(splat):
        coordinator.handle(event)
    assert coordinator.servers.idle() == [again.server]


def test_a_worker_that_could_not_link_gets_a_part_again_only_if_no_other_is_left() -> None:
    coordinator, first = unlinked()
    again, other = (replace(first, server=number) for number in (20, 21))
    for event in joins(again, replace(other, process="another one there")):
        coordinator.handle(event)
    assert coordinator.servers.idle() == [other.server]
    coordinator.handle(ServerLost(SECOND, GONE))
    told = coordinator.handle(ServerLost(other.server, GONE))
    assert coordinator.failure is None and (again.server, messages.DescribeVolume) in sent(told)


def joined_anew(servers: Servers, number: int, process: str) -> None:
    servers.add(ServerJoined(number, Role.MAPSHADE_SERVER, f"map/shade server {number}", "", NO_DATA, process=process))
    servers.describe(number, messages.MachineDescribed(1, threads=1))


def with_one_that_stays() -> Servers:
    servers = Servers()
    joined_anew(servers, FIRST, "one that stays")
    servers.workers = [FIRST]
    return servers


def test_a_process_that_joins_and_is_lost_again_and_again_gets_no_part_until_others_have_drawn() -> None:
    servers, causes = with_one_that_stays(), list[str]()
    for number in range(20, 20 + MOST_LOSSES):
        joined_anew(servers, number, "the same")
        assert servers.idle() == [number]
        servers.workers.append(number)
        lost = servers.lose(number, GONE)
        assert lost is not None
        causes.append(lost.cause)
    assert [LOST_AGAIN in cause for cause in causes] == [False] * (MOST_LOSSES - 1) + [True]
    joined_anew(servers, 30, "the same")
    joined_anew(servers, 31, "another one")
    for _ in range(KEPT_OUT):
        assert servers.idle() == [31] and servers.ready(Role.MAPSHADE_SERVER)[-1] == 30
        servers.drew_whole([FIRST])
    assert {*servers.idle()} == {30, 31}
    servers.workers.append(30)
    lost = servers.lose(30, GONE)
    assert lost is not None and lost.cause == GONE, "it is told once"
    joined_anew(servers, 32, "the same")
    servers.lose(31, GONE)
    assert servers.idle() == []
    servers.lose(FIRST, GONE)
    assert servers.idle() == [32], "nobody else is left"


def test_one_that_had_a_part_in_a_whole_frame_is_as_good_as_new() -> None:
    servers = with_one_that_stays()
    for number in range(20, 30 + MOST_LOSSES):
        joined_anew(servers, number, "the same")
        assert servers.idle() == [number]
        servers.workers.append(number)
        servers.drew_whole([FIRST, number])
        servers.lose(number, GONE)


def test_bounds_outside_the_volume_end_the_frame_but_not_the_session() -> None:
    coordinator = drawing()
    outside = Scene(tables=SCENE.tables, bounds=Bounds(low=(0, 0, 0), high=(9, 9, 9)))
    (*_, ended) = coordinator.handle(FrameAsked(2, outside, Step.F, require_complete=True))
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput) and "bounds on i" in str(ended.error)
    assert (SPLAT, messages.RenderFrame) in sent(
        coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=True))
    )


def test_the_only_splat_server_that_is_lost_while_the_volume_is_described_fails_the_session() -> None:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED), ASKED]:
        coordinator.handle(event)
    coordinator.handle(ServerLost(SPLAT, "it is gone"))
    (failed,) = coordinator.handle(NOBODY)
    assert isinstance(failed, FailSession)


def test_nobody_waits_in_vain_for_one_that_a_session_had_no_use_for_yet() -> None:
    coordinator = CheckedCoordinator()
    for event in joins(*JOINED):
        coordinator.handle(event)
    coordinator.handle(ServerLost(SPLAT, "it is gone"))
    assert coordinator.handle(NOBODY) == []
    assert coordinator.failure is None


def test_an_idle_splat_server_may_leave() -> None:
    coordinator = drawing()
    coordinator.handle(ServerJoined(9, Role.SPLAT_SERVER, "splat server 9", "node9", DATA))
    assert coordinator.handle(ServerLost(9, "left")) == []


def test_a_frame_that_must_wait_stops_the_running_one_at_once() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    asked = coordinator.handle(FrameAsked(2, narrow, Step.F, require_complete=True))
    assert sent(asked)[:3] == [(n, messages.AbortFrame) for n in (FIRST, SECOND, SPLAT)]
    assert EndFrame(1) in asked


def test_a_refused_frame_ends_alone_and_is_aborted_everywhere() -> None:
    coordinator = drawing()
    *aborts, ended = coordinator.handle(said(SPLAT, messages.Refused("RenderFrame", "no memory", frame=1)))
    assert sent(aborts) == [(n, messages.AbortFrame) for n in (FIRST, SECOND, SPLAT)]
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput)
    assert (SPLAT, messages.RenderFrame) in sent(
        coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=True))
    )


def test_answers_of_an_older_assignment_count_for_nothing() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    coordinator.handle(FrameAsked(2, narrow, Step.F, require_complete=True))
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=360, no_data=0)
    for server in (FIRST, SECOND):
        assert coordinator.handle(said(server, messages.SubCubesRead(1, survey, 0.1))) == []
    assert coordinator.holding.phase == Phase.READING


# -- a map/shade server is lost: the volume is 8 x 9 x 10, and the halves meet at k = 5

LOWER, UPPER = Box((0, 0, 0), (8, 9, 5)), Box((0, 0, 5), (8, 9, 10))
GONE = "map/shade server 2 at node2:40123 is gone"
MISSING = f"{GONE}; i 0-7, j 0-8, k 0-4 of the volume are missing"
NO_HEIR = ReportLoss("no memory; nobody takes over what was lost")
HANDED_OVER = f"{GONE}; others take over i 0-7, j 0-8, k 0-4 of the volume"
ALL = Box((0, 0, 0), (8, 9, 10))
LATE = ServerJoined(4, Role.MAPSHADE_SERVER, "map/shade server 4", "node4", NO_DATA)


def boxes_told(instructions: list[Instruction]) -> dict[int, list[Box]]:
    """What servers are told to hold from now on."""
    changes = [(i.server, i.message) for i in instructions if isinstance(i, Send)]
    return {server: one.boxes for server, one in changes if isinstance(one, messages.ChangeSubCubes)}


def to_read(instructions: list[Instruction]) -> dict[int, messages.ReadAhead]:
    """What servers are told to read beside frames."""
    told = [(i.server, i.message) for i in instructions if isinstance(i, Send)]
    return {server: one for server, one in told if isinstance(one, messages.ReadAhead)}


def read_ahead(coordinator: CheckedCoordinator, instructions: list[Instruction]) -> list[Instruction]:
    """All servers have read what they are told to: what comes of it."""
    last: list[Instruction] = []
    for server, one in to_read(instructions).items():
        last = coordinator.handle(said(server, messages.AheadRead(one.reading)))
    return last


def lose_first(coordinator: CheckedCoordinator) -> list[Instruction]:
    """It is lost, and the others have read what it held: what comes of it."""
    return read_ahead(coordinator, coordinator.handle(ServerLost(FIRST, GONE)))


def shown(frame: int = 1) -> CheckedCoordinator:
    """A screen's frame is being drawn."""
    coordinator = drawing(frame)
    finished(coordinator, frame, [FIRST, SECOND])
    coordinator.handle(FrameAsked(frame + 1, SCENE, Step.F, require_complete=False))
    return coordinator


def ended_by(instructions: list[Instruction]) -> str:
    """The line with which a frame ends."""
    (ended,) = [i for i in instructions if isinstance(i, EndFrame)]
    assert isinstance(ended.error, PeerLost)
    return str(ended.error)


def finished(coordinator: CheckedCoordinator, frame: int, workers: list[int]) -> PublishImage:
    """What is published once these workers and the splat server are done."""
    for worker in workers:
        coordinator.handle(said(worker, messages.FrameMapped(frame, MAP_STATS, [])))
    coordinator.handle(said(SPLAT, messages.FrameFinished(frame, True, [], SPLAT_STATS)))
    image, *_ = coordinator.handle(
        said(SPLAT, messages.ImageRead(frame, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16))
    )
    assert isinstance(image, PublishImage) and image.outcome is not None
    return image


def test_a_lost_map_shade_server_ends_the_running_frame_and_the_others_read_its_part() -> None:
    coordinator = drawing()
    told = coordinator.handle(ServerLost(FIRST, GONE))
    assert told[0] == ReportLoss(HANDED_OVER)
    assert ended_by(told) == HANDED_OVER
    stopped = [(SECOND, messages.AbortFrame), (SPLAT, messages.AbortFrame)]
    invited = (SPLAT, messages.InviteWorkers)
    assert sent(told) == [invited, *stopped, (SECOND, messages.ReadAhead)]
    assert to_read(told)[SECOND].boxes == [ALL]
    assert not any(isinstance(i, FailSession) for i in told)
    told = read_ahead(coordinator, told)
    assert sent(told) == [invited, (SECOND, messages.ChangeSubCubes)]
    assert boxes_told(told) == {SECOND: [ALL]}


def test_a_screen_sees_what_is_left_and_then_all_of_it() -> None:
    coordinator = shown()
    ahead = coordinator.handle(ServerLost(FIRST, GONE))
    asked = coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=False))
    renders = [i for i in asked if isinstance(i, Send)]
    assert [render.server for render in renders] == [SECOND, SPLAT]
    for render in renders:
        assert isinstance(render.message, messages.RenderFrame) and list(render.message.workers) == [SECOND]
    coordinator.handle(said(SECOND, messages.FrameMapped(3, MAP_STATS, [])))
    coordinator.handle(said(SPLAT, messages.FrameFinished(3, True, [], SPLAT_STATS)))
    image, *told = coordinator.handle(
        said(SPLAT, messages.ImageRead(3, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16))
    )
    assert isinstance(image, PublishImage) and image.outcome is not None
    assert image.outcome.missing == (LOWER,) and image.outcome.healing
    assert not boxes_told(told)
    assert boxes_told(read_ahead(coordinator, ahead)) == {SECOND: [ALL]}
    assert sent(coordinator.handle(FrameAsked(4, SCENE, Step.F, require_complete=False))) == []
    begun = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert sent(begun) == [(SECOND, messages.RenderFrame), (SPLAT, messages.RenderFrame)]
    whole = finished(coordinator, 4, [SECOND])
    assert whole.outcome is not None and whole.outcome.missing == () and not whole.outcome.healing


def test_who_wants_the_whole_volume_waits_until_it_is_there_again() -> None:
    coordinator = shown()
    ahead = coordinator.handle(ServerLost(FIRST, GONE))
    assert sent(coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=True))) == []
    assert boxes_told(read_ahead(coordinator, ahead)) == {SECOND: [ALL]}
    begun = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert sent(begun) == [(SECOND, messages.RenderFrame), (SPLAT, messages.RenderFrame)]


@pytest.mark.parametrize("ahead", [True, False])
def test_what_others_cannot_read_is_missing_until_a_server_joins(ahead: bool) -> None:
    coordinator = drawing()
    if ahead:
        coordinator.handle(ServerLost(FIRST, GONE))
        refusal = messages.Refused("ReadAhead", "no memory", held=1)
    else:
        lose_first(coordinator)
        refusal = messages.Refused("ChangeSubCubes", "no memory", assignment=2, held=1)
    assert NO_HEIR in coordinator.handle(said(SECOND, refusal))
    assert coordinator.servers.missing == (LOWER,)
    why_missing = f"{MISSING}; nobody takes over: no memory"
    assert losses([*coordinator.servers.states.values()]) == {FIRST: why_missing}
    assert ended_by(coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=True))) == why_missing
    coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=False))
    left = finished(coordinator, 3, [SECOND])
    assert left.outcome is not None and left.outcome.missing == (LOWER,) and not left.outcome.healing
    told = [one for event in joins(LATE) for one in coordinator.handle(event)]
    assert [one.boxes for one in to_read(told).values()] == [[LOWER]], "what is held need not be read"
    assert boxes_told(read_ahead(coordinator, told)) == {SECOND: [UPPER], LATE.server: [LOWER]}


def test_a_server_that_joins_before_others_refuse_is_asked_next() -> None:
    coordinator = drawing()
    lose_first(coordinator)
    for event in joins(LATE):
        coordinator.handle(event)
    told = coordinator.handle(said(SECOND, messages.Refused("ChangeSubCubes", "no memory", assignment=2, held=1)))
    assert NO_HEIR not in told and [one.boxes for one in to_read(told).values()] == [[LOWER]]
    assert boxes_told(read_ahead(coordinator, told)) == {SECOND: [UPPER], LATE.server: [LOWER]}


def asked_again(coordinator: CheckedCoordinator, frames: int, first: int) -> list[list[Instruction]]:
    """What comes of so many frames that want the whole volume."""
    return [coordinator.handle(FrameAsked(first + n, SCENE, Step.F, require_complete=True)) for n in range(frames)]


def test_what_nobody_could_read_is_tried_again_after_ever_more_frames_and_told_once() -> None:
    coordinator, frame = drawing(), 2
    coordinator.handle(ServerLost(FIRST, GONE))
    refused = said(SECOND, messages.Refused("ReadAhead", "no memory", held=1))
    assert NO_HEIR in coordinator.handle(refused)
    for frames in (TRIED_AGAIN_AFTER, 2 * TRIED_AGAIN_AFTER):
        *before, last = asked_again(coordinator, frames, frame)
        frame += frames
        assert all("nobody takes over: no memory" in ended_by(told) for told in before)
        assert to_read(last)[SECOND].boxes == [ALL] and not any(isinstance(i, EndFrame) for i in last), "it waits"
        ended = coordinator.handle(refused)
        assert NO_HEIR not in ended and "no memory" in ended_by(ended)
    *_, last = asked_again(coordinator, 4 * TRIED_AGAIN_AFTER, frame)
    assert boxes_told(read_ahead(coordinator, last)) == {SECOND: [ALL]}
    begun = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert sent(begun) == [(SECOND, messages.RenderFrame), (SPLAT, messages.RenderFrame)]


def shared_by_three() -> CheckedCoordinator:
    """One has joined late, and has its part."""
    coordinator = drawing()
    for event in joins(LATE):
        coordinator.handle(event)
    finished(coordinator, 1, [FIRST, SECOND])
    for server in (FIRST, SECOND, LATE.server):
        coordinator.handle(said(server, messages.VoxelsPacked(2, 1, 0.1)))
    return coordinator


@pytest.mark.parametrize("first", ["accepts", "refuses"])
def test_what_one_takes_over_and_another_refuses_is_told_once_both_have_answered(first: str) -> None:
    """They hold parts that do not fit together."""
    coordinator = shared_by_three()
    lose_first(coordinator)
    accepts = said(SECOND, messages.VoxelsPacked(3, 1, 0.1))
    refuses = said(LATE.server, messages.Refused("ChangeSubCubes", "no memory", assignment=3, held=2))
    before, last = (accepts, refuses) if first == "accepts" else (refuses, accepts)
    assert coordinator.handle(before) == []
    assert coordinator.handle(last) == [ReportProgress("no memory; the volume is read anew for the next image")]
    asked = coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=True))
    assert sent(asked) == [(server, messages.ReadSubCubes) for server in (SECOND, LATE.server)]


@pytest.mark.parametrize("causes", [("no memory", "no memory"), ("no memory", "no such file")])
def test_what_all_refuse_to_take_over_is_told_once_with_each_cause(causes: tuple[str, str]) -> None:
    coordinator = shared_by_three()
    lose_first(coordinator)
    told = [
        one
        for server, cause in zip((SECOND, LATE.server), causes, strict=True)
        for one in coordinator.handle(said(server, messages.Refused("ChangeSubCubes", cause, assignment=3, held=2)))
    ]
    assert told == [ReportLoss(f"{'; '.join(dict.fromkeys(causes))}; nobody takes over what was lost")]


def taken_over_by_two() -> CheckedCoordinator:
    """As the first of three was lost."""
    coordinator = shared_by_three()
    lose_first(coordinator)
    for server in (SECOND, LATE.server):
        coordinator.handle(said(server, messages.VoxelsPacked(3, 1, 0.1)))
    return coordinator


def test_a_second_loss_that_cannot_be_made_good_is_not_taken_for_the_first() -> None:
    coordinator = taken_over_by_two()
    lost = tuple(coordinator.holding.boxes[SECOND])
    read_ahead(coordinator, coordinator.handle(ServerLost(SECOND, "it is gone as well")))
    coordinator.handle(said(LATE.server, messages.Refused("ChangeSubCubes", "no memory", assignment=4, held=3)))
    assert coordinator.servers.missing == lost


def test_a_refusal_to_read_ahead_leaves_an_earlier_loss_made_good() -> None:
    coordinator = taken_over_by_two()
    lost = tuple(coordinator.holding.boxes[SECOND])
    coordinator.handle(ServerLost(SECOND, "it is gone as well"))
    coordinator.handle(said(LATE.server, messages.Refused("ReadAhead", "no memory", held=3)))
    assert coordinator.servers.missing == lost
    assert losses([*coordinator.servers.states.values()])[SECOND].endswith("nobody takes over: no memory")
    told = [one for event in joins(replace(LATE, server=9)) for one in coordinator.handle(event)]
    assert "nobody" not in losses([*coordinator.servers.states.values()])[SECOND], "somebody reads it"
    parts = boxes_told(read_ahead(coordinator, told))
    assert sum(box.voxels for boxes in parts.values() for box in boxes) == ALL.voxels


def test_a_server_that_an_error_keeps_from_being_heard_is_lost_where_others_are_left() -> None:
    coordinator = drawing()
    told = coordinator.handle(ServingFailed(FIRST, GONE))
    assert ReportLoss(HANDED_OVER) in told and coordinator.failure is None
    coordinator.handle(ServingFailed(SECOND, "server 1 is heard no more"))
    assert str(coordinator.failure) == "the session cannot go on: server 1 is heard no more"


def test_one_that_joins_gets_a_part_between_two_frames() -> None:
    coordinator = drawing()
    told = [one for event in joins(LATE) for one in coordinator.handle(event)]
    assert sent(told) == [(LATE.server, messages.DescribeMachine)], "a frame is being drawn"
    for worker in (FIRST, SECOND):
        coordinator.handle(said(worker, messages.FrameMapped(1, MAP_STATS, [])))
    coordinator.handle(said(SPLAT, messages.FrameFinished(1, True, [], SPLAT_STATS)))
    _, *told = coordinator.handle(
        said(SPLAT, messages.ImageRead(1, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16))
    )
    assert sent(told)[:2] == [(SPLAT, messages.InviteWorkers), (LATE.server, messages.ConnectToSplatServers)]
    parts = boxes_told(told)
    assert parts.keys() == {FIRST, SECOND, LATE.server}
    assert sum(box.voxels for boxes in parts.values() for box in boxes) == ALL.voxels


def test_the_last_map_shade_server_takes_the_session_with_it_if_no_other_joins() -> None:
    coordinator = drawing()
    for server in (FIRST, SECOND):
        assert not any(isinstance(one, FailSession) for one in coordinator.handle(ServerLost(server, GONE)))
    (failed,) = coordinator.handle(NobodyJoined("map/shade server 3 is gone"))
    assert isinstance(failed, FailSession) and str(failed.error) == "map/shade server 3 is gone"


def test_one_that_has_joined_in_time_draws() -> None:
    coordinator = drawing()
    for event in (ServerLost(FIRST, GONE), ServerLost(SECOND, GONE), *joins(LATE), NOBODY):
        assert not any(isinstance(one, FailSession) for one in coordinator.handle(event))
    assert coordinator.holding.boxes == {LATE.server: [ALL]}


def test_a_person_hears_that_another_server_is_to_be_started() -> None:
    coordinator = drawing()
    coordinator.servers.states = {n: replace(one, by_hand=True) for n, one in coordinator.servers.states.items()}
    told = coordinator.handle(ServerLost(SPLAT, GONE))
    awaited = f"{GONE}; another splat server that joins within 60 s takes over its part of the image"
    assert ReportLoss(awaited) in told


def test_one_that_held_nothing_yet_takes_the_place_of_all_others() -> None:
    coordinator = surveyed()
    for event in joins(LATE):
        coordinator.handle(event)
    for server in (FIRST, SECOND):
        told = coordinator.handle(ServerLost(server, GONE))
        assert not any(isinstance(one, FailSession) for one in told)
    while not coordinator.holding.settled:
        coordinator.handle(read_by(coordinator, LATE.server))
    assert coordinator.holding.boxes == {LATE.server: [ALL]}


@pytest.mark.parametrize("first", [SPLAT, FIRST, SECOND])
def test_after_the_loss_of_all_those_who_join_in_their_places_draw(first: int) -> None:
    coordinator = shown()
    lost = (first, *(one for one in (SPLAT, FIRST, SECOND) if one != first))
    told = [one for server in lost for one in coordinator.handle(ServerLost(server, GONE))]
    assert ReportLoss(f"{GONE}; another one is started in its place and takes over its part of the image") in told
    others = [isinstance(one, ReportLoss) and "others take over" in one.text for one in told]
    assert sum(others) == 1, "of two map/shade servers the first one alone leaves another"
    coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=False))
    for event in joins(LATE, ServerJoined(9, Role.SPLAT_SERVER, "splat server 9", "node9", DATA)):
        coordinator.handle(event)
    assert coordinator.holding.boxes == {LATE.server: [ALL]}


def test_a_splat_server_that_joins_late_draws_from_the_next_frame_on() -> None:
    coordinator = drawing()
    late = ServerJoined(9, Role.SPLAT_SERVER, "splat server 9", "node9", DATA)
    told = [one for event in joins(late) for one in coordinator.handle(event)]
    linked = [(FIRST, messages.ConnectToSplatServers), (SECOND, messages.ConnectToSplatServers)]
    invited = [(SPLAT, messages.InviteWorkers), (9, messages.InviteWorkers)]
    assert sent(told) == [(9, messages.DescribeMachine), *invited, *linked]
    finished(coordinator, 1, [FIRST, SECOND])
    asked = coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=False))
    assert (9, messages.RenderFrame) in sent(asked)


def test_a_loss_while_voxels_are_packed_ends_the_frame_that_waits_and_the_next_one_goes_on() -> None:
    coordinator = surveyed()
    coordinator.handle(FrameAsked(1, SCENE, Step.F, require_complete=True))
    coordinator.handle(said(SECOND, messages.VoxelsPacked(1, 0, 0.1)))
    told = coordinator.handle(ServerLost(FIRST, GONE))
    assert ended_by(told) == HANDED_OVER
    assert boxes_told(read_ahead(coordinator, told)) == {SECOND: [ALL]}
    assert sent(coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=False))) == []
    begun = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert sent(begun) == [(SECOND, messages.RenderFrame), (SPLAT, messages.RenderFrame)]


@pytest.mark.parametrize("already_read", [False, True])
def test_after_a_loss_while_sub_cubes_are_read_again_the_others_read_all(already_read: bool) -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    coordinator.handle(FrameAsked(2, narrow, Step.F, require_complete=False))
    if already_read:
        coordinator.handle(read_by(coordinator, SECOND))
    assert ended_by(coordinator.handle(ServerLost(FIRST, GONE))) == HANDED_OVER
    coordinator.handle(FrameAsked(3, narrow, Step.F, require_complete=False))
    while coordinator.holding.phase is Phase.READING:
        told = coordinator.handle(read_by(coordinator, SECOND))
    assert coordinator.holding.boxes == {SECOND: [ALL]}
    assert sent(told) == [(SECOND, messages.PackVoxels)]
    drawn = coordinator.handle(said(SECOND, messages.VoxelsPacked(coordinator.holding.assignment, 0, 0.1)))
    assert sent(drawn) == [(SECOND, messages.RenderFrame), (SPLAT, messages.RenderFrame)]


def check_linked_anew(coordinator: CheckedCoordinator, told: list[Instruction], frame: int) -> None:
    """A link of the first worker, and it alone, is dropped and made anew before the next frame."""
    (ended,) = [one for one in told if isinstance(one, EndFrame)]
    assert ended.frame == frame and isinstance(ended.error, ImageIncomplete) and coordinator.failure is None
    asked = [(one.server, one.message) for one in told if isinstance(one, Send)]
    first, again = [message for _, message in asked if isinstance(message, messages.ConnectToSplatServers)]
    assert not first.routes and [route.server for route in again.routes] == [SPLAT]
    assert {server for server, message in asked if message in (first, again)} == {FIRST}
    assert not sent(coordinator.handle(FrameAsked(frame + 1, SCENE, Step.F, require_complete=True)))
    assert not sent(coordinator.handle(said(FIRST, messages.ConnectedToSplatServers([]))))
    drawn = coordinator.handle(said(FIRST, messages.ConnectedToSplatServers([SPLAT])))
    assert sent(drawn) == [(server, messages.RenderFrame) for server in (FIRST, SECOND, SPLAT)]


def unlinked_in(frame: int, teller: int) -> MessageReceived:
    """The first worker's link has ended amid the frame."""
    if teller == SPLAT:
        return said(SPLAT, messages.FrameFinished(frame, False, [FIRST], SPLAT_STATS))
    return said(FIRST, messages.FrameMapped(frame, MAP_STATS, [SPLAT]))


def drawing_linked() -> CheckedCoordinator:
    coordinator = drawing()
    for worker in (FIRST, SECOND):
        coordinator.handle(said(worker, messages.ConnectedToSplatServers([SPLAT])))
    return coordinator


@pytest.mark.parametrize("teller", [FIRST, SPLAT])
def test_a_link_that_ends_is_made_anew_as_long_as_that_helps(teller: int) -> None:
    coordinator = drawing_linked()
    for frame in range(1, 3 * MOST_MADE_ANEW, 2):
        check_linked_anew(coordinator, coordinator.handle(unlinked_in(frame, teller)), frame)
        told = [one for event in all_drawn(frame + 1) for one in coordinator.handle(event)]
        assert any(isinstance(one, PublishImage) for one in told)
        coordinator.handle(FrameAsked(frame + 2, SCENE, Step.F, require_complete=True))


def all_drawn(frame: int) -> list[MessageReceived]:
    return [
        *(said(worker, messages.FrameMapped(frame, MAP_STATS, [])) for worker in (FIRST, SECOND)),
        said(SPLAT, messages.FrameFinished(frame, True, [], SPLAT_STATS)),
        said(SPLAT, messages.ImageRead(frame, Step.F, True, 0, 0, 1, 1, messages.RawPixels()), bytes(16)),
    ]


@pytest.mark.parametrize("teller", [FIRST, SPLAT])
def test_a_worker_whose_link_ends_again_and_again_is_lost_once(teller: int) -> None:
    """The splat server is the only one, and the other worker reaches it."""
    coordinator = drawing_linked()
    for frame in range(1, MOST_MADE_ANEW + 1):
        check_linked_anew(coordinator, coordinator.handle(unlinked_in(frame, teller)), frame)
    told = coordinator.handle(unlinked_in(MOST_MADE_ANEW + 1, teller))
    assert "map/shade server 2 has no connection to splat server 1; others take over i 0-7" in ended_by(told)
    assert sent(told)[0] == (FIRST, messages.EndSession)
    assert coordinator.handle(said(FIRST, messages.FrameMapped(MOST_MADE_ANEW + 1, MAP_STATS, []))) == []
    assert coordinator.handle(ServerLost(FIRST, GONE)) == []


def test_a_loss_while_a_frame_is_aborted_lets_it_end_as_aborted() -> None:
    coordinator = drawing()
    coordinator.handle(AbortAsked(1))
    told = coordinator.handle(ServerLost(FIRST, GONE))
    assert EndFrame(1) in told and (SECOND, messages.AbortFrame) not in sent(told)


def test_the_states_of_all_servers_are_known_and_those_lost_are_kept() -> None:
    coordinator = drawing()
    coordinator.handle(ServerJoined(4, Role.MAPSHADE_SERVER, "map/shade server 4", "node4", NO_DATA))
    before = coordinator.server_states
    lose_first(coordinator)
    splat, first, second, idle = coordinator.server_states.values()
    assert (splat.name, splat.host, splat.boxes, splat.lost) == ("splat server 1", "node1", (), False)
    assert (first.name, first.boxes, first.voxels, first.lost, first.cause) == (
        "map/shade server 2",
        (LOWER,),
        360,
        True,
        GONE,
    )
    assert first.handed_over and (second.boxes, second.lost) == ((ALL,), False)
    assert (idle.host, idle.boxes, idle.lost) == ("node4", (), False)
    assert not before[FIRST].lost, "who looks from another thread keeps what it saw"


# -- probes

NEAR, FAR = messages.ProbedVoxel((1, 2, 9), 7.0, 0.5), messages.ProbedVoxel((1, 2, 1), 8.0, 0.25)  # k rises to the eye
POINT = PointAsked(5, SCENE, 12.5, 7.25)


def seen(server: int, voxel: messages.ProbedVoxel | None = None, question: int = 5) -> MessageReceived:
    return said(server, messages.VoxelProbed(question, voxel))


@pytest.mark.parametrize("first_found", [None, FAR, NEAR])
@pytest.mark.parametrize("second_found", [None, FAR, NEAR])
def test_a_probe_asks_all_and_takes_the_front_most(
    first_found: messages.ProbedVoxel | None, second_found: messages.ProbedVoxel | None
) -> None:
    coordinator = drawing()
    asked = coordinator.handle(POINT)
    assert sent(asked) == [(FIRST, messages.ProbeVoxels), (SECOND, messages.ProbeVoxels)]
    assert coordinator.handle(seen(FIRST, first_found)) == []
    found = (first_found, second_found)
    front = NEAR if NEAR in found else FAR if FAR in found else None
    assert coordinator.handle(seen(SECOND, second_found)) == [GiveAnswer(5, front)]


def test_probes_may_overtake_each_other() -> None:
    coordinator = drawing()
    coordinator.handle(POINT)
    coordinator.handle(PointAsked(6, SCENE, 1.0, 1.0))
    coordinator.handle(seen(FIRST, question=6))
    assert coordinator.handle(seen(SECOND, question=6)) == [GiveAnswer(6, None)]
    coordinator.handle(seen(SECOND, FAR))
    assert coordinator.handle(seen(FIRST)) == [GiveAnswer(5, FAR)]


def test_a_probe_by_numbers_that_nothing_can_be_computed_with_is_refused_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def wanted(*_: object, **__: object) -> None:
        raise ValueError("strength must have a finite scale")

    coordinator = drawing()
    with monkeypatch.context() as patch:
        patch.setattr(coordinator.holding, "wanted", wanted)
        (refused,) = coordinator.handle(PointAsked(6, SCENE, 1.0, 1.0))
    assert isinstance(refused, GiveAnswer) and refused.question == 6 and isinstance(refused.error, BadInput)
    assert sent(coordinator.handle(POINT)) == [(FIRST, messages.ProbeVoxels), (SECOND, messages.ProbeVoxels)]


def test_a_probe_waits_until_the_voxels_are_packed() -> None:
    coordinator = surveyed()
    assert sent(coordinator.handle(POINT)) == [(FIRST, messages.PackVoxels), (SECOND, messages.PackVoxels)]
    assert sent(packed(coordinator)) == [(FIRST, messages.ProbeVoxels), (SECOND, messages.ProbeVoxels)]


def test_a_probe_by_other_rules_has_the_sub_cubes_read_again() -> None:
    coordinator = drawing()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    asked = coordinator.handle(PointAsked(5, narrow, 1.0, 1.0))
    assert sent(asked) == [(FIRST, messages.ReadSubCubes), (SECOND, messages.ReadSubCubes)]
    survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=360, no_data=0)
    for server in (FIRST, SECOND):
        coordinator.handle(said(server, messages.SubCubesRead(2, survey, 0.1)))
    (ask, _) = [i.message for i in packed(coordinator, 2) if isinstance(i, Send)]
    assert isinstance(ask, messages.ProbeVoxels)
    assert (ask.assignment, ask.drawing.quantisation.window) == (2, (0.0, 9.0))


def test_after_a_loss_a_probe_is_asked_anew_of_those_who_take_over() -> None:
    coordinator = drawing()
    coordinator.handle(POINT)
    coordinator.handle(seen(SECOND, FAR))
    told = coordinator.handle(ServerLost(FIRST, GONE))
    assert not any(isinstance(one, GiveAnswer) for one in told)
    read_ahead(coordinator, told)
    told = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert (SECOND, messages.ProbeVoxels) in sent(told)
    assert coordinator.handle(seen(SECOND, NEAR)) == [GiveAnswer(5, NEAR)]


def test_a_slice_is_asked_anew_after_a_loss_of_who_then_holds_more() -> None:
    coordinator = drawing()
    ask = SliceAsked(5, SCENE, axis=2, index=4, longest=99)
    assert sent(coordinator.handle(ask)) == [(FIRST, messages.ReadSlice), (SECOND, messages.ReadSlice)]
    told = coordinator.handle(ServerLost(FIRST, GONE))
    half, whole = Rectangle(0, 0, 4, 9), Rectangle(0, 0, 8, 9)
    late = said(SECOND, messages.SliceRead(5, 1, [half]), bytes(8 * 36))  # it held the half when it was asked
    read_ahead(coordinator, told)
    told = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert (SECOND, messages.ReadSlice) in sent(told)
    assert coordinator.handle(late) == []
    (answer,) = coordinator.handle(said(SECOND, messages.SliceRead(5, 2, [whole]), bytes(8 * 72)))
    assert isinstance(answer, GiveAnswer) and isinstance(answer.found, VolumeSlice) and answer.found.held.all()


def test_a_slice_that_a_server_makes_larger_than_it_is_costs_that_server_its_place() -> None:
    coordinator = drawing()
    coordinator.handle(SliceAsked(5, SCENE, axis=2, index=4, longest=99))
    told = coordinator.handle(said(FIRST, messages.SliceRead(5, 1, [Rectangle(0, 0, 9, 9)]), bytes(8 * 81)))
    assert any(isinstance(one, CutOff) and one.server == FIRST for one in told)


def test_counts_of_the_plane_are_summed_and_asked_anew_after_a_loss() -> None:
    coordinator = drawing()
    asked = coordinator.handle(PlaneAsked(5, SCENE))
    assert sent(asked) == [(FIRST, messages.CountPlane), (SECOND, messages.CountPlane)]
    threes, fours = (struct.pack("<Q", count) + bytes(8 * 65535) for count in (3, 4))
    assert coordinator.handle(said(FIRST, messages.PlaneCounted(5, 1), threes)) == []
    (answer,) = coordinator.handle(said(SECOND, messages.PlaneCounted(5, 1), fours))
    assert isinstance(answer, GiveAnswer) and isinstance(answer.found, PlaneCounts)
    assert (answer.found.counts[0], answer.found.voxels) == (7, 7)

    coordinator.handle(PlaneAsked(6, SCENE))
    coordinator.handle(said(SECOND, messages.PlaneCounted(6, 1), fours))
    told = coordinator.handle(ServerLost(FIRST, GONE))
    read_ahead(coordinator, told)
    told = coordinator.handle(said(SECOND, messages.VoxelsPacked(2, 360, 0.1)))
    assert (SECOND, messages.CountPlane) in sent(told)
    (answer,) = coordinator.handle(said(SECOND, messages.PlaneCounted(6, 2), threes))
    assert isinstance(answer, GiveAnswer) and isinstance(answer.found, PlaneCounts) and answer.found.voxels == 3


def test_a_server_that_counts_more_voxels_than_there_can_be_costs_its_place() -> None:
    coordinator = drawing()
    coordinator.handle(PlaneAsked(5, SCENE))
    many = struct.pack("<Q", (1 << 64) - 1) + bytes(8 * 65535)
    coordinator.handle(said(FIRST, messages.PlaneCounted(5, 1), many))
    told = coordinator.handle(said(SECOND, messages.PlaneCounted(5, 1), many))
    assert any(isinstance(one, CutOff) and one.server == SECOND for one in told)


def test_a_failed_session_ends_all_probes() -> None:
    coordinator = drawing()
    coordinator.handle(POINT)
    told = [*coordinator.handle(ServerLost(SPLAT, "the splat server is gone")), *coordinator.handle(NOBODY)]
    (answer,) = [i for i in told if isinstance(i, GiveAnswer)]
    assert isinstance(answer.error, PeerLost)
    assert coordinator.handle(POINT) == [answer]


def test_a_refused_probe_ends_alone() -> None:
    coordinator = drawing()
    coordinator.handle(POINT)
    (answer,) = coordinator.handle(said(FIRST, messages.Refused("ProbeVoxels", "no memory", question=5)))
    assert isinstance(answer, GiveAnswer) and str(answer.error) == "no memory"
    assert coordinator.handle(seen(SECOND, FAR)) == []
    assert coordinator.failure is None


# -- a volume that only comes whole: FIRST lends


def asked_parts(instructions: list[Instruction]) -> list[messages.VolumePart]:
    """Those that the lender is asked for."""
    reads = [i for i in instructions if isinstance(i, Send) and isinstance(i.message, messages.ReadPart)]
    assert {read.server for read in reads} <= {FIRST}
    return [read.message.part for read in reads if isinstance(read.message, messages.ReadPart)]


def test_one_server_reads_for_all_and_each_gets_one_part_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("volsplat.client.coordinator.holding.lending.PART_BYTES", 400)
    coordinator = lending()
    told = coordinator.handle(said(FIRST, LENT))
    assert sent(told)[:2] == [(SECOND, messages.AwaitParts), (THIRD, messages.AwaitParts)]
    on_the_way = asked_parts(told)
    assert sorted(part.server for part in on_the_way) == [SECOND, THIRD]
    got: dict[int, int] = {SECOND: 0, THIRD: 0}
    ends: list[tuple[int, type]] = []
    while on_the_way:
        part = on_the_way.pop()
        values = bytes(2 * part.box.voxels)
        (held,) = coordinator.handle(said(FIRST, messages.PartRead(1, part), values))
        assert isinstance(held, Send) and (held.server, held.message) == (part.server, messages.HoldPart(1, part))
        assert held.payload == values
        got[part.server] += part.box.voxels
        told = coordinator.handle(said(part.server, messages.PartHeld(1)))
        on_the_way += asked_parts(told)
        assert len({part.server for part in on_the_way}) == len(on_the_way)
        ends += [ask for ask in sent(told) if ask[1] is messages.ReadSubCubes]
    boxes = coordinator.holding.boxes
    assert got == {server: boxes[server][0].grown(1, (8, 9, 10)).voxels for server in (SECOND, THIRD)}
    assert ends == [(FIRST, messages.ReadSubCubes)]
    for server in (THIRD, FIRST):
        assert coordinator.handle(read_by(coordinator, server)) == []
    counts = coordinator.handle(read_by(coordinator, SECOND))
    assert {kind for _, kind in sent(counts)} == {messages.CountHistograms}


def test_a_single_server_reads_for_itself() -> None:
    coordinator = CheckedCoordinator()
    for event in [*joins(*JOINED[:2]), VolumeAsked("/volumes/head.nrrd", workers=1)]:
        coordinator.handle(event)
    told = coordinator.handle(said(FIRST, messages.VolumeDescribed(WHOLE, None, IDENTITY)))
    assert (FIRST, messages.ReadSubCubes) in sent(told)


def lent() -> CheckedCoordinator:
    """All have their parts and draw."""
    coordinator = lending()
    for server in (FIRST, SECOND, THIRD):
        coordinator.handle(read_by(coordinator, server))
    for server in (FIRST, SECOND, THIRD):
        coordinator.handle(counted(server, 200))
    coordinator.handle(FrameAsked(1, SCENE, Step.F, require_complete=False))
    for server in (FIRST, SECOND, THIRD):
        coordinator.handle(said(server, messages.VoxelsPacked(1, 0, 0.1)))
    return coordinator


def lending_again() -> CheckedCoordinator:
    """The volume was drawn once and is read again for another window."""
    coordinator = lent()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))
    told = coordinator.handle(FrameAsked(2, narrow, Step.F, require_complete=False))
    assert sent(told)[-1] == (FIRST, messages.LendVolume)
    return coordinator


def test_another_server_lends_where_the_lender_is_lost() -> None:
    coordinator = lending_again()
    coordinator.handle(said(FIRST, messages.VolumeLent(2, ["uint16"])))
    told = coordinator.handle(ServerLost(FIRST, GONE))
    assert sent(told)[-1] == (SECOND, messages.LendVolume)
    assert coordinator.handle(said(THIRD, messages.PartHeld(2))) == [], "of the reading before"
    told = coordinator.handle(said(SECOND, messages.VolumeLent(3, ["uint16"])))
    assert (THIRD, messages.AwaitParts) in sent(told)


@pytest.mark.parametrize("lent_before", [True, False])
def test_lending_goes_on_without_the_receivers_that_are_lost(lent_before: bool) -> None:
    coordinator = lending_again()
    lent = said(FIRST, messages.VolumeLent(2, ["uint16"]))
    late = asked_parts(coordinator.handle(lent)) if lent_before else []
    coordinator.handle(ServerLost(SECOND, "it is gone"))
    told = coordinator.handle(ServerLost(THIRD, "it is gone"))
    if not lent_before:
        told = coordinator.handle(lent)
        assert (FIRST, messages.ReadSubCubes) in sent(told)
    for part in late:
        assert coordinator.handle(said(FIRST, messages.PartRead(2, part), bytes(2 * part.box.voxels))) == []
    coordinator.handle(read_by(coordinator, FIRST))
    assert coordinator.holding.boxes == {FIRST: [ALL]}, "it reads all of it"


def test_when_all_are_lost_while_one_lends_another_one_reads_all() -> None:
    coordinator = lending_again()
    for event in joins(replace(LATE, server=9)):
        coordinator.handle(event)
    for server in (SECOND, THIRD, FIRST):
        told = coordinator.handle(ServerLost(server, "it is gone"))
        assert not any(isinstance(one, FailSession) for one in told)
    assert coordinator.holding.boxes == {9: [ALL]}
    asked = coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=True))
    assert (9, messages.ReadSubCubes) in sent(asked)


def test_what_was_lost_of_a_volume_that_nobody_can_read_again_is_missing() -> None:
    coordinator = lent()
    finished(coordinator, 1, [FIRST, SECOND, THIRD])
    lost = tuple(coordinator.holding.boxes[THIRD])
    told = coordinator.handle(ServerLost(THIRD, GONE))
    assert (FIRST, messages.LendVolume) in sent(told)
    refusal = messages.Refused("LendVolume", "no memory", assignment=2, held=1)
    assert coordinator.handle(said(FIRST, refusal)) == [NO_HEIR]
    assert coordinator.servers.missing == lost
    assert "are missing" in ended_by(coordinator.handle(FrameAsked(2, SCENE, Step.F, require_complete=True)))
    coordinator.handle(FrameAsked(3, SCENE, Step.F, require_complete=False))
    left = finished(coordinator, 3, [FIRST, SECOND])
    assert left.outcome is not None and left.outcome.missing == lost and not left.outcome.healing


def test_a_new_server_that_nobody_lends_to_is_not_taken_to_hold_a_part() -> None:
    coordinator = lent()
    for event in joins(replace(LATE, server=9)):
        coordinator.handle(event)
    finished(coordinator, 1, [FIRST, SECOND, THIRD])
    told = coordinator.handle(ServerLost(THIRD, GONE))
    assert (FIRST, messages.LendVolume) in sent(told) and 9 in coordinator.holding.boxes
    for frame in (2, 3, 4):
        newest = coordinator.holding.assignments.newest
        refused = said(FIRST, messages.Refused("LendVolume", "no such file", assignment=newest, held=1))
        coordinator.handle(refused)
        asked = coordinator.handle(FrameAsked(frame, SCENE, Step.F, require_complete=False))
        assert sent(asked) == [(FIRST, messages.LendVolume)], "nothing is drawn before it is read"


# -- a prepared volume: 64 x 64 x 64 voxels and two coarser levels


def zoomed(zoom: float) -> Scene:
    return Scene(tables=SCENE.tables, view=View(zoom=zoom))


def levels_opened(instructions: list[Instruction]) -> list[int]:
    """The levels that the first server is to hold."""
    opens = [i.message for i in instructions if isinstance(i, Send) and isinstance(i.message, messages.OpenPackets)]
    assert len(opens) in (0, 2) and all(box.voxels for one in opens for held in one.levels for box in held.boxes)
    return [held.level for held in opens[0].levels] if opens else []


def drawn_from(instructions: list[Instruction]) -> set[tuple[int, int]]:
    """Level and stride that the servers are told."""
    told = [i.message for i in instructions if isinstance(i, Send)]
    return {(m.drawing.level, m.drawing.plan.strides[0]) for m in told if isinstance(m, messages.RenderFrame)}


def test_of_a_prepared_volume_a_step_has_the_levels_opened_that_it_needs() -> None:
    coordinator = opened_store()
    assert levels_opened(coordinator.handle(FrameAsked(1, zoomed(1.0), Step.A, require_complete=True))) == [2]
    assert drawn_from(packed(coordinator)) == {(2, 1)}
    assert levels_opened(coordinator.handle(FrameAsked(2, zoomed(1.0), Step.B, require_complete=True))) == [1, 2]
    assert drawn_from(packed(coordinator, 2)) == {(1, 1)}
    assert levels_opened(coordinator.handle(FrameAsked(3, zoomed(1.0), Step.F, require_complete=True))) == [0, 1, 2]
    assert drawn_from(packed(coordinator, 3)) == {(0, 1)}
    assert drawn_from(coordinator.handle(FrameAsked(4, zoomed(1.0), Step.A, require_complete=True))) == {(2, 1)}


def test_another_base_level_keeps_what_is_held_of_its_levels() -> None:
    coordinator = opened_store()
    coordinator.handle(FrameAsked(1, zoomed(1.0), Step.F, require_complete=True))
    packed(coordinator)
    far = coordinator.handle(FrameAsked(4, zoomed(0.5), Step.A, require_complete=True))
    assert levels_opened(far) == [1, 2] and drawn_from(far) == set()
    assert drawn_from(packed(coordinator, 2)) == {(2, 2)}


def test_who_moves_does_not_wait_for_a_finer_level() -> None:
    coordinator = opened_store()
    coordinator.handle(FrameAsked(1, zoomed(1.0), Step.B, require_complete=False))
    packed(coordinator)
    assert levels_opened(coordinator.handle(FrameAsked(2, zoomed(1.0), Step.C, require_complete=False))) == [0, 1, 2]
    assert levels_opened(coordinator.handle(FrameAsked(3, zoomed(1.0), Step.A, require_complete=False))) == [1, 2]
    assert coordinator.handle(said(FIRST, messages.VoxelsPacked(2, 0, 0.1))) == [], "of what was given up"
    assert drawn_from(packed(coordinator, 3)) == {(2, 1)}


def test_who_wants_a_finer_level_waits_for_it_once() -> None:
    coordinator = opened_store()
    coordinator.handle(FrameAsked(1, zoomed(1.0), Step.C, require_complete=False))
    assert levels_opened(coordinator.handle(FrameAsked(2, zoomed(1.0), Step.F, require_complete=False))) == []
    assert levels_opened(coordinator.handle(FrameAsked(3, zoomed(0.4), Step.F, require_complete=False))) == [1, 2]
    assert drawn_from(packed(coordinator, 2)) == {(1, 1)}


def test_who_moves_keeps_a_level_that_is_only_just_too_fine() -> None:
    coordinator = opened_store()
    coordinator.handle(FrameAsked(1, zoomed(1.0), Step.F, require_complete=False))
    packed(coordinator)
    assert drawn_from(coordinator.handle(FrameAsked(2, zoomed(0.5), Step.F, require_complete=False))) == {(0, 1)}
    assert levels_opened(coordinator.handle(FrameAsked(3, zoomed(0.4), Step.F, require_complete=False))) == [1, 2]


@pytest.mark.parametrize(("memory", "has"), [(600_000, 1 << 40), (None, 1_200_000)])
def test_what_does_not_fit_is_drawn_coarser(memory: int | None, has: int) -> None:
    """Half of the volume takes 990 kB with its levels. By itself a server takes half of what its machine has left."""
    coordinator = opened_store(memory, has)
    assert levels_opened(coordinator.handle(FrameAsked(1, zoomed(1.0), Step.F, require_complete=True))) == [1, 2]


def test_a_frame_by_rules_that_a_volume_was_not_prepared_with_ends_alone() -> None:
    coordinator = opened_store()
    narrow = Scene(tables=SCENE.tables, quantise=Quantise(window=(1.0, 9.0)))
    (ended,) = coordinator.handle(FrameAsked(1, narrow, Step.F, require_complete=True))
    assert isinstance(ended, EndFrame) and isinstance(ended.error, BadInput) and "--window 1,9" in str(ended.error)
    (answer,) = coordinator.handle(PointAsked(5, narrow, 1.0, 1.0))
    assert isinstance(answer, GiveAnswer) and isinstance(answer.error, BadInput)
    assert levels_opened(coordinator.handle(FrameAsked(2, zoomed(1.0), Step.F, require_complete=True))) == [0, 1, 2]


def test_a_probe_of_a_prepared_volume_looks_at_what_is_held() -> None:
    coordinator = opened_store()
    assert levels_opened(coordinator.handle(PointAsked(5, zoomed(0.5), 1.0, 1.0))) == [1, 2]
    (ask, _) = [i.message for i in packed(coordinator) if isinstance(i, Send)]
    assert isinstance(ask, messages.ProbeVoxels) and ask.drawing.level == 1
    asked = coordinator.handle(PointAsked(6, zoomed(4.0), 1.0, 1.0))
    assert sent(asked) == [(FIRST, messages.ProbeVoxels), (SECOND, messages.ProbeVoxels)]


def test_the_only_splat_server_leaves_once_it_is_known_who_has_joined() -> None:
    coordinator = surveyed()
    newcomer, described = joins(MORE_SPLAT_SERVERS[0])
    coordinator.handle(newcomer)
    assert sent(coordinator.handle(said(SPLAT, messages.LeaveSession()))) == []
    assert (SPLAT, messages.EndSession) in sent(coordinator.handle(described))
    assert coordinator.failure is None


def test_who_leaves_waits_for_no_newcomer_that_is_lost() -> None:
    coordinator = surveyed()
    newcomer = MORE_SPLAT_SERVERS[0]
    coordinator.handle(newcomer)
    coordinator.handle(said(SPLAT, messages.LeaveSession()))
    told = coordinator.handle(ServerLost(newcomer.server, "it was cut off"))
    assert (SPLAT, messages.EndSession) in sent(told)
    assert not coordinator.servers.splat_servers


def test_depths_of_blocks_are_asked_anew_of_other_patches_and_not_of_other_colours() -> None:
    def frame(number: int, **patch: object) -> messages.RenderFrame:
        scene = SCENE.with_(patches=[{"density": (0.2, 0.6), **patch}])
        drawing = Drawing.of(scene, IN_SLABS, GEOMETRY, QUANTISATION)
        return messages.RenderFrame(number, 1, drawing, {1: 1}, REGIONS, True)

    depths = BlockDepths()
    ((server, asked),) = depths.ask(frame(1), [1])
    blocks = light_block_dims(GEOMETRY.dims)
    depths.take(server, messages.DepthsSummed(1, 1, blocks), bytes(8 * math.prod(blocks)))
    assert asked.frame == 1 and not depths.under_way
    assert depths.ask(frame(2, refl="red"), [1]) == []
    assert [server for server, _ in depths.ask(frame(3, opacity=0.9), [1])] == [1]
