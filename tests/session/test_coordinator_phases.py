"""What a server says in the wrong phase cuts it off, in one line; the session goes on if it can without that server."""

from collections.abc import Callable

import msgspec
import pytest

from support.messages.coordinated import (
    ASKED,
    DESCRIPTION,
    FIRST,
    JOINED,
    MAP_STATS,
    MORE_SPLAT_SERVERS,
    NO_DATA,
    SCENE,
    SECOND,
    SPLAT,
    SPLAT_STATS,
    THIRD,
    CheckedCoordinator,
    drawing,
    joins,
    read_by,
    said,
    surveyed,
)
from support.messages.message_samples import IDENTITY, SAMPLES
from volsplat.client.coordinator.coordinator import OWNERS
from volsplat.client.coordinator.events.events import FrameAsked, ServerJoined
from volsplat.client.coordinator.events.instructions import CutOff, FailSession, Instruction, PublishImage
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.handlers import handlers
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.vocabulary import MESSAGES

STATES = {
    kind: handler.states
    for owner in OWNERS
    for kind, handler in handlers(owner).items()
    if kind in MESSAGES and handler.states
}
WRONG = [(phase, kind) for phase in Phase for kind, states in STATES.items() if phase not in states]
NARROW = Scene(tables=SCENE.tables, quantise=Quantise(window=(0.0, 9.0)))


def gathering() -> CheckedCoordinator:
    coordinator = CheckedCoordinator()
    for event in joins(*JOINED):
        coordinator.handle(event)
    return coordinator


def describing() -> CheckedCoordinator:
    coordinator = gathering()
    coordinator.handle(ASKED)
    return coordinator


def reading() -> CheckedCoordinator:
    coordinator = describing()
    coordinator.handle(said(FIRST, messages.VolumeDescribed(DESCRIPTION, None, IDENTITY)))
    return coordinator


def counting() -> CheckedCoordinator:
    coordinator = reading()
    for server in (FIRST, SECOND):
        coordinator.handle(read_by(coordinator, server))
    return coordinator


def packing() -> CheckedCoordinator:
    coordinator = surveyed()
    coordinator.handle(FrameAsked(1, SCENE, Step.F, require_complete=False))
    return coordinator


def reading_again() -> CheckedCoordinator:
    coordinator = drawing()
    coordinator.handle(FrameAsked(2, NARROW, Step.F, require_complete=False))
    return coordinator


def empty() -> CheckedCoordinator:
    coordinator = reading_again()
    for server in (FIRST, SECOND):
        coordinator.handle(said(server, messages.Refused("ReadSubCubes", "no memory", assignment=2)))
    return coordinator


IN: dict[Phase, Callable[[], CheckedCoordinator]] = {
    Phase.GATHERING: gathering,
    Phase.DESCRIBING: describing,
    Phase.READING: reading,
    Phase.COUNTING: counting,
    Phase.SURVEYED: surveyed,
    Phase.PACKING: packing,
    Phase.READY: drawing,
    Phase.EMPTY: empty,
}


def say(coordinator: CheckedCoordinator, server: int, kind: type[Message]) -> list[Instruction]:
    """What is told after a server has said this, about the assignment that is under way."""
    message, payload = SAMPLES[kind]
    if "assignment" in kind.__struct_fields__:
        message = msgspec.structs.replace(message, assignment=coordinator.holding.assignment)
    return coordinator.handle(said(server, message, payload))


def cut_off(told: list[Instruction], server: int) -> str:
    """The line with which this server alone is cut off, before anything else."""
    (cut,) = [i for i in told if isinstance(i, CutOff)]
    assert told[0] == cut and cut.server == server
    return cut.cause


@pytest.mark.parametrize(("phase", "kind"), WRONG, ids=lambda value: getattr(value, "__name__", None) or value.name)
def test_the_wrong_phase_ends_a_connection_and_not_the_session(phase: Phase, kind: type[Message]) -> None:
    coordinator = IN[phase]()
    assert coordinator.holding.phase == phase
    coordinator.handle(ServerJoined(THIRD, Role.MAPSHADE_SERVER, "map/shade server 4", "node4", NO_DATA))
    told = say(coordinator, THIRD, kind)
    fault = f"{kind.__name__} came while the volume is {phase.value}"
    assert cut_off(told, THIRD) == f"map/shade server 4 broke the protocol: {fault}"
    assert coordinator.failure is None and THIRD not in coordinator.servers.joined
    told = say(coordinator, SECOND, kind)
    assert cut_off(told, SECOND) == f"map/shade server 3 broke the protocol: {fault}"
    assert not any(isinstance(i, FailSession) for i in told)


OTHER_SPLAT = MORE_SPLAT_SERVERS[0]
TWO_ROWS = msgspec.structs.replace(SPLAT_STATS, work=[1, 1])
LIES: dict[str, tuple[int, messages.Message, str]] = {
    "work in other rows": (
        SPLAT,
        messages.FrameFinished(1, True, [], TWO_ROWS),
        "it counted its work in 2 rows of tiles, but has 1",
    ),
    "a part that it has not": (
        OTHER_SPLAT.server,
        messages.FrameFinished(1, True, [], SPLAT_STATS),
        "it draws nothing of frame 1",
    ),
    "no splat server": (
        FIRST,
        messages.FrameMapped(1, MAP_STATS, [99]),
        "it cannot reach [99] for frame 1, but its splat servers are [1]",
    ),
    "no worker": (
        SPLAT,
        messages.FrameFinished(1, False, [99], SPLAT_STATS),
        "frame 1 is incomplete for lack of [99], but its workers are [2, 3]",
    ),
    "another step": (
        SPLAT,
        messages.ImageRead(1, Step.E, True, 0, 0, 1, 1, messages.RawPixels()),
        "the image of frame 1 is step E and ",
    ),
    "another place": (
        SPLAT,
        messages.ImageRead(1, Step.F, True, 1, 0, 1, 1, messages.RawPixels()),
        "the image of frame 1 is step F and ",
    ),
}


@pytest.mark.parametrize(("server", "message", "fault"), LIES.values(), ids=LIES)
def test_what_cannot_be_said_of_a_frame_ends_the_connection_and_is_not_believed(
    server: int, message: messages.Message, fault: str
) -> None:
    coordinator = drawing()
    for event in joins(OTHER_SPLAT):
        coordinator.handle(event)
    told = coordinator.handle(said(server, message, bytes(16) if isinstance(message, messages.ImageRead) else b""))
    assert f"broke the protocol: {fault}" in cut_off(told, server)
    assert coordinator.failure is None and not any(isinstance(i, PublishImage) for i in told)


def test_every_message_that_a_server_may_say_at_any_time_is_no_answer_about_the_volume_but_what_is_read_ahead() -> None:
    free = {kind for owner in OWNERS for kind, handler in handlers(owner).items() if kind in MESSAGES}
    assert free - STATES.keys() == {
        messages.MachineDescribed,
        messages.ConnectedToSplatServers,
        messages.LeaveSession,
        messages.Refused,
        messages.FolderListed,  # which may be asked before there is a volume
        messages.AheadRead,  # comes beside whatever else goes on
    }
