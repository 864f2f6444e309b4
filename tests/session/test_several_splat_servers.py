"""The coordinator with several splat servers: who draws which lines, and what happens when one of them is lost."""

import pytest

from support.messages.coordinated import (
    DESCRIPTION,
    FIRST,
    JOINED,
    MORE_SPLAT_SERVERS,
    SECOND,
    SPLAT,
    CheckedCoordinator,
    joins,
    packed,
    said,
    sent,
    surveyed,
)
from support.messages.drawn import (
    BIG,
    GONE,
    LEFT,
    LOST,
    SIDE,
    THREE,
    all_done,
    check_whole,
    drawing_big,
    finished,
    image,
    mapped,
    published,
    rectangles,
    rendered,
    running,
)
from support.messages.message_samples import IDENTITY
from volsplat.client.coordinator.data_routes import MOST_MADE_ANEW
from volsplat.client.coordinator.events.events import (
    AbortAsked,
    Event,
    FrameAsked,
    MessageReceived,
    NobodyJoined,
    PartialImageAsked,
    ProgressAsked,
    ServerLost,
    VolumeAsked,
)
from volsplat.client.coordinator.events.instructions import EndFrame, FailSession, Instruction, ReportProgress, Send
from volsplat.client.coordinator.server_states import ImageIncomplete
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.regions import lines_of


def test_the_volume_waits_for_as_many_as_were_asked_for_and_all_are_linked_to() -> None:
    coordinator = CheckedCoordinator()
    coordinator.handle(VolumeAsked("/volumes/head.nrrd", workers=2, splat_servers=2))
    *_, waiting = [coordinator.handle(event) for event in joins(*JOINED)]
    assert "1 of 2 splat servers joined" in str(waiting)
    *_, asked = [coordinator.handle(event) for event in joins(MORE_SPLAT_SERVERS[0])]
    assert sent(asked) == [(FIRST, messages.DescribeVolume)]
    told = coordinator.handle(said(FIRST, messages.VolumeDescribed(DESCRIPTION, None, IDENTITY)))
    assert sent(told)[:2] == [(SPLAT, messages.InviteWorkers), (LOST, messages.InviteWorkers)], (
        "before they are linked to"
    )
    assert linked(told) == [[SPLAT, LOST]] * 2


def linked(told: list[Instruction]) -> list[list[int]]:
    """The splat servers that each worker is to link to."""
    asked = [i.message for i in told if isinstance(i, Send) and isinstance(i.message, messages.ConnectToSplatServers)]
    return [[route.server for route in ask.routes] for ask in asked]


def test_the_image_is_shared_out_and_laid_together() -> None:
    coordinator = surveyed(3)
    coordinator.handle(FrameAsked(1, BIG, Step.F, require_complete=True))
    request = rendered(packed(coordinator))
    assert [region.server for region in request.regions] == THREE
    *before, last = all_done(request)
    assert not [shown for event in before for shown in published(coordinator.handle(event))]
    (shown,) = published(coordinator.handle(last))
    check_whole(shown)
    assert shown.complete and shown.outcome is not None and shown.outcome.splat.keys() == set(THREE)


def test_the_next_frame_is_cut_by_what_there_was_to_do() -> None:
    coordinator = drawing_big()
    request = running(coordinator)
    for event in all_done(request):
        if isinstance(event, MessageReceived) and isinstance(event.message, messages.FrameFinished):
            event = finished(request, event.server, 1000 if event.server == SPLAT else 0)
        coordinator.handle(event)
    begin, end = lines_of(request.regions, SPLAT)
    again = rendered(coordinator.handle(FrameAsked(2, BIG, Step.F, require_complete=True)))
    assert lines_of(again.regions, SPLAT)[1] < end, "it was the only one that had anything to do"


def test_a_partial_image_is_there_once_all_have_answered() -> None:
    coordinator = drawing_big()
    request = running(coordinator)
    coordinator.handle(finished(request, SPLAT))
    asked = coordinator.handle(PartialImageAsked(1))
    assert sent(asked) == [(LOST, messages.ReadImage), (LEFT, messages.ReadImage)], "the first has finished"
    assert coordinator.handle(image(request, LOST, False)) == []
    assert coordinator.handle(image(request, SPLAT, True)) == []
    (shown,) = published(coordinator.handle(image(request, LEFT, False)))
    check_whole(shown)
    assert not shown.complete


def says_how_far(coordinator: CheckedCoordinator, server: int, share: float) -> list[Instruction]:
    return coordinator.handle(said(server, messages.FrameProgress(1, share)))


def test_the_one_that_is_behind_says_how_far_a_frame_is() -> None:
    coordinator = drawing_big()
    assert sent(coordinator.handle(ProgressAsked(1))) == [(server, messages.ReadProgress) for server in THREE]
    assert says_how_far(coordinator, SPLAT, 0.75) == says_how_far(coordinator, LOST, 0.25) == []
    assert coordinator.handle(ProgressAsked(1)) == [], "one of them is slow to answer"
    assert says_how_far(coordinator, LEFT, 0.5) == [ReportProgress("step F: 25 %")]
    request = running(coordinator)
    for event in (finished(request, LOST), image(request, LOST, complete=True)):
        coordinator.handle(event)
    assert sent(coordinator.handle(ProgressAsked(1))) == [(server, messages.ReadProgress) for server in (SPLAT, LEFT)]
    assert says_how_far(coordinator, SPLAT, 0.75) == []
    assert says_how_far(coordinator, LEFT, 0.6) == [ReportProgress("step F: 60 %")], "who has finished is not behind"


def test_one_that_finished_and_was_lost_is_not_asked_how_far_it_is() -> None:
    coordinator = drawing_big()
    request = running(coordinator)
    coordinator.handle(ProgressAsked(1))
    for event in (finished(request, LOST), image(request, LOST, complete=True), ServerLost(LOST, GONE)):
        coordinator.handle(event)
    assert says_how_far(coordinator, SPLAT, 0.75) == []
    assert says_how_far(coordinator, LEFT, 0.6) == [ReportProgress("step F: 60 %")]


def test_nobody_is_asked_how_far_an_aborted_frame_is() -> None:
    coordinator = drawing_big()
    coordinator.handle(ProgressAsked(1))
    coordinator.handle(AbortAsked(1))
    assert coordinator.handle(ProgressAsked(1)) == says_how_far(coordinator, SPLAT, 0.75) == []


def test_a_splat_server_is_lost_amid_a_frame_and_the_others_draw_it_anew() -> None:
    coordinator = drawing_big()
    request = running(coordinator)
    coordinator.handle(PartialImageAsked(1))
    for server in THREE:
        coordinator.handle(image(request, server, False))
    told = coordinator.handle(ServerLost(LOST, GONE))
    assert linked(told) == [[SPLAT, LEFT]] * 2
    (shown,) = published(told)
    assert shown.missing == (rectangles(request)[LOST],) and not shown.complete
    assert shown.missing[0] not in [part.rectangle for part in shown.parts] and len(shown.parts) == 2
    (ended,) = [i for i in told if isinstance(i, EndFrame)]
    assert isinstance(ended.error, ImageIncomplete) and GONE in str(ended.error)
    again = rendered(coordinator.handle(FrameAsked(2, BIG, Step.F, require_complete=True)))
    assert {region.server for region in again.regions} == {SPLAT, LEFT}
    told = [one for event in all_done(again) for one in coordinator.handle(event)]
    (shown,) = published(told)
    check_whole(shown)
    assert shown.complete and coordinator.server_states[LOST].lost


def test_a_splat_server_that_is_lost_once_its_part_is_here_is_not_missed() -> None:
    coordinator = drawing_big()
    request = running(coordinator)
    for event in (finished(request, LOST), image(request, LOST, True)):
        coordinator.handle(event)
    assert not [i for i in coordinator.handle(ServerLost(LOST, GONE)) if isinstance(i, EndFrame)]
    told = [i for event in all_done(request) if _by(event) != LOST for i in coordinator.handle(event)]
    (shown,) = published(told)
    check_whole(shown)


def _by(event: Event) -> int:
    assert isinstance(event, MessageReceived)
    return event.server


def test_a_splat_server_that_a_worker_cannot_reach_counts_as_lost_once_links_to_it_end_again_and_again() -> None:
    coordinator = drawing_big()
    for worker in (FIRST, SECOND):
        coordinator.handle(said(worker, messages.ConnectedToSplatServers(THREE)))
    for frame in range(1, MOST_MADE_ANEW + 1):
        told = coordinator.handle(mapped(running(coordinator), FIRST, LOST))
        assert linked(told) == [[SPLAT, LEFT], THREE]
        coordinator.handle(FrameAsked(frame + 1, BIG, Step.F, require_complete=True))
        for reached in linked(told):
            coordinator.handle(said(FIRST, messages.ConnectedToSplatServers(reached)))
    told = coordinator.handle(mapped(running(coordinator), FIRST, LOST))
    assert (LOST, messages.EndSession) in sent(told)
    (ended,) = [i for i in told if isinstance(i, EndFrame)]
    assert "splat server 8 has no connection to map/shade server 2" in str(ended.error)


def test_a_splat_server_that_a_worker_cannot_link_to_is_done_without() -> None:
    coordinator = drawing_big()
    assert coordinator.handle(said(FIRST, messages.ConnectedToSplatServers(THREE))) == []
    told = coordinator.handle(said(SECOND, messages.ConnectedToSplatServers([SPLAT, LEFT])))
    assert (LOST, messages.EndSession) in sent(told) and coordinator.failure is None
    assert linked(told) == [[SPLAT, LEFT]] * 2


def test_what_a_worker_could_not_reach_before_it_was_told_anew_counts_for_nothing() -> None:
    coordinator = drawing_big()
    coordinator.handle(ServerLost(LOST, GONE))
    refused = messages.Refused("ConnectToSplatServers", "cannot reach splat server 8", reason=messages.Reason.PEER_LOST)
    assert coordinator.handle(said(FIRST, refused)) == [], "it has been told since to do without"
    assert sent(coordinator.handle(said(FIRST, refused)))[0] == (FIRST, messages.EndSession)


def test_the_last_splat_server_takes_the_session_with_it_if_no_other_joins() -> None:
    coordinator = drawing_big()
    for server in (SPLAT, LEFT, LOST):
        assert not [i for i in coordinator.handle(ServerLost(server, GONE)) if isinstance(i, FailSession)]
    failed = coordinator.handle(NobodyJoined(GONE))[-1]
    assert isinstance(failed, FailSession)


def test_an_abort_waits_for_every_splat_server_that_is_there() -> None:
    coordinator = drawing_big()
    assert sent(coordinator.handle(AbortAsked(1))) == [(n, messages.AbortFrame) for n in (FIRST, SECOND, *THREE)]
    for server in (FIRST, SECOND, SPLAT, LEFT):
        assert EndFrame(1) not in coordinator.handle(said(server, messages.FrameAborted(1)))
    assert EndFrame(1) in coordinator.handle(ServerLost(LOST, GONE))


@pytest.mark.parametrize("wrong", [(0, 0, SIDE, SIDE), (0, 0, SIDE, 0)])
def test_a_part_that_is_not_its_senders_cuts_that_one_off(wrong: tuple[int, int, int, int]) -> None:
    coordinator = drawing_big()
    read = messages.ImageRead(1, Step.F, False, *wrong, messages.RawPixels())
    told = coordinator.handle(said(LOST, read, bytes(read.payload_bytes())))
    assert told[0].server == LOST and coordinator.failure is None  # type: ignore[union-attr]
    assert coordinator.server_states[LOST].lost
