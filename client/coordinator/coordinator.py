"""The client's decisions: events in, instructions out. It knows no socket, thread or clock.

An event is something that happened (a server joined, a message came, a person asked for a frame); the answer is a
list of instructions that the session carries out. This file decides what a server that comes, is lost or refuses means
for the others; `gathering` decides when the volume is begun, `holding` how it gets to the servers, `sharing_out` when
parts of it change hands, and `frames` and the files of questions and listings what comes of what is asked. Each method
says which event or message it takes, and in which phase that may come (see handlers; the table is printed in
docs/how_it_works/protocol.md). Servers may join and be lost at any time: between two frames those that join get a share
of the volume, or of the image, and what was lost with a server is taken over by others. A server that says what cannot
be, or says it in the wrong phase, is cut off.
"""

from collections.abc import Iterable
from typing import get_args

from volsplat.client.coordinator.data_routes import DataRoutes
from volsplat.client.coordinator.events.events import (
    Event,
    FrameAsked,
    MessageReceived,
    NobodyJoined,
    Question,
    ServerJoined,
    ServerLost,
    ServerProcessEnded,
    ServersMissing,
    ServingFailed,
)
from volsplat.client.coordinator.events.instructions import (
    CutOff,
    EndFrame,
    FailSession,
    GiveAnswer,
    Instruction,
    ReportLoss,
    ReportProgress,
    Send,
)
from volsplat.client.coordinator.file_voxel_questions import FileVoxelQuestions
from volsplat.client.coordinator.folder_listings import FolderListings
from volsplat.client.coordinator.frames import Frames
from volsplat.client.coordinator.gathering import Gathering
from volsplat.client.coordinator.holding.phase import SURVEYED_PHASES, Phase
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.reading_ahead import ReadingAhead
from volsplat.client.coordinator.server_states import ImageIncomplete, ServerState, handed_over
from volsplat.client.coordinator.servers import Servers
from volsplat.client.coordinator.sharing_out import SharingOut
from volsplat.client.coordinator.voxel_questions import VoxelQuestions
from volsplat.client.coordinator.work_shares import WorkShares
from volsplat.protocol.messages.frame_messages import FrameFinished, FrameMapped
from volsplat.protocol.messages.handlers import Handler, check_handlers, handlers, takes
from volsplat.protocol.messages.link_messages import LinkMeasured
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.messages.session_messages import (
    ConnectedToSplatServers,
    ConnectToSplatServers,
    DescribeMachine,
    EndSession,
    LeaveSession,
    MachineDescribed,
    Reason,
    Refused,
)
from volsplat.protocol.messages.trace_messages import ClockRead, FrameTraced
from volsplat.protocol.messages.vocabulary import taken_by
from volsplat.protocol.messages.volume_messages import ReadAhead, VolumeDescribed
from volsplat.protocol.text.errors import BadInput, PeerLost, RemoteProtocolError, VolsplatError


class Coordinator:
    """The state machine of a session. `handle` is its only door."""

    def __init__(self) -> None:
        self.servers = Servers()
        self.holding = VolumeHolding()
        self.gathering = Gathering(self.servers, self.holding)
        self.routes = DataRoutes(self.servers)
        work = WorkShares(self.holding)
        self.frames = Frames(self.servers, self.routes, self.holding, work)
        self.sharing = SharingOut(self.servers, self.holding, self.gathering, self.routes, work)
        self.voxel_questions = VoxelQuestions(self.holding)
        self.file_questions = FileVoxelQuestions(self.holding)
        self.folders = FolderListings(self.servers, self.holding)
        self._questions = (self.voxel_questions, self.file_questions, self.folders)
        self.failure: VolsplatError | None = None
        self._given_up: set[str] = set()  # processes that ended, and have no other in their place
        self._handlers: dict[type, tuple[object, Handler]] = {
            kind: (owner, handler)
            for owner in (self, self.gathering, self.holding, self.frames, *self._questions, self.sharing.ahead)
            for kind, handler in handlers(type(owner)).items()
        }

    @property
    def server_states(self) -> dict[int, ServerState]:
        """Of those that are there, and of those that were lost with a part of the volume. Any thread may look."""
        return self.servers.states

    def handle(self, event: Event) -> list[Instruction]:
        """Take one event. Raises nothing: what goes wrong is an instruction."""
        if self.failure is not None:
            return self._refused_after_failure(event, self.failure)
        if isinstance(event, FrameAsked):
            self.sharing.frame_asked()
        owner, handler = self._handlers[type(event)]
        told: list[Instruction] = handler.method(owner, event)
        return [*told, *self._go_on()]

    def _refused_after_failure(self, event: Event, failure: VolsplatError) -> list[Instruction]:
        if isinstance(event, FrameAsked):
            return [EndFrame(event.frame, failure)]
        return [GiveAnswer(event.question, error=failure)] if isinstance(event, Question) else []

    def _go_on(self) -> list[Instruction]:
        """Begin the frame that waits and send the questions that do, if the servers are ready for them.

        Before that servers may leave, and sub-cubes change hands, unless a frame is being drawn. Nobody leaves before
        it is known who else is there: they may be the last.
        """
        if self.failure is not None:
            return []
        refused = self.sharing.tell_refused()
        resting = self.frames.idle and (self.holding.settled or self.holding.phase is Phase.GATHERING)
        left = self._let_go() if resting and self.servers.all_are_known else []
        shared = list[Instruction]()
        if resting and self.failure is None:
            shared = self.sharing.share(at_once=bool(left), may_be_whole=self.frames.may_be_whole)
        self.servers.hold(self.holding.boxes)
        begun = self.frames.begin()
        return [*refused, *left, *shared, *begun, *([] if self.sharing.heals else self.voxel_questions.send())]

    def _fail(self, error: VolsplatError) -> list[Instruction]:
        """Whoever hears that what they wait for will not come finds that the session has failed."""
        self.failure = error
        answers = [told for questions in self._questions for told in questions.failed(error)]
        return [FailSession(error), *self.frames.fail(error), *answers]

    # -- servers come and go

    @takes(ServerJoined)
    def _joined(self, event: ServerJoined) -> list[Instruction]:
        self.servers.add(event)
        return [Send(event.server, DescribeMachine())]

    @takes(MachineDescribed)
    def _machine_described(self, message: MachineDescribed, event: MessageReceived) -> list[Instruction]:
        self.servers.describe(event.server, message)
        if self.holding.phase is Phase.GATHERING:
            return [*self.folders.send(), *self.gathering.begin()]
        return self._join(event.server)

    def _join(self, server: int) -> list[Instruction]:
        """One that comes later than the volume: a splat server draws from the next frame on, others get a part."""
        servers, boxes = self.servers, self.holding.boxes
        self.holding.assignments.may_move = True
        if servers.joined[server].role is not Role.SPLAT_SERVER:
            return []
        servers.draw_with(server)
        return [*self.routes.invite(boxes), *self.routes.connect(boxes)]

    @takes(ServerLost)
    def _lost(self, event: ServerLost) -> list[Instruction]:
        return self._lose(event.server, event.cause)

    def _send_off(self, server: int, cause: str) -> list[Instruction]:
        """Go on without one that lives."""
        return [Send(server, EndSession()), *self._lose(server, cause)]

    def _lose(self, number: int, cause: str) -> list[Instruction]:
        """Go on without this server if others can do its work; else the session fails."""
        return [*self.folders.lost(number), *self._lose_work(number, cause)]

    def _lose_work(self, number: int, cause: str) -> list[Instruction]:
        joined, lost = self.servers.joined.get(number), self.servers.lose(number, cause)
        if joined is None or lost is None:
            return []
        if lost.role is Role.SPLAT_SERVER:
            return self._lose_splat_server(lost, self._is_replaced(joined))
        if not (self.servers.chosen or self.servers.idle() or self._is_replaced(joined)):
            return self._fail(PeerLost(cause))
        if self.holding.volume is None:
            return self._lose_unsurveyed(lost)
        held = self.holding.lose(number)
        self.sharing.ahead.lose(number)
        self.holding.assignments.may_move = True
        told = handed_over(lost)
        invited = self.routes.invite(self.holding.boxes)  # no other's link is kept
        ended = self.frames.end(ImageIncomplete(told))
        self.voxel_questions.lost(number)
        return [ReportLoss(told), *invited, *ended, *self.file_questions.lost(number), *held]

    def _lose_unsurveyed(self, lost: ServerState) -> list[Instruction]:
        """The volume is described or read anew, by the others, or by whoever joins."""
        begun = self.holding.lose_unsurveyed(lost.id)
        self.servers.hand_over()
        told = ReportLoss(handed_over(lost))
        if self.holding.phase is Phase.GATHERING:
            begun = self.gathering.begin_anew()
        return [told, *self.routes.invite(self.holding.boxes), *begun]

    @takes(LeaveSession)
    def _leave(self, message: LeaveSession, event: MessageReceived) -> list[Instruction]:
        """It serves on until nothing that it does is under way."""
        servers = self.servers
        servers.leaving = list(dict.fromkeys([*servers.leaving, event.server]))
        return [ReportProgress(f"{servers.name(event.server)} was told to end and leaves")]

    def _let_go(self) -> list[Instruction]:
        """Go on without the servers that leave; as they are between two frames, none is incomplete for it."""
        told: list[Instruction] = []
        for server in self.servers.leaving:
            told += self._send_off(server, f"{self.servers.name(server)} left: it was told to end")
        return told

    def _is_replaced(self, joined: ServerJoined) -> bool:
        """Whether another one is awaited in its place."""
        return joined.process not in self._given_up

    def _lose_splat_server(self, lost: ServerState, replaced: bool) -> list[Instruction]:
        if not (self.servers.splat_servers or replaced):
            return self._fail(PeerLost(lost.cause))
        return [ReportLoss(handed_over(lost)), *self.frames.lose(lost), *self.routes.connect(self.holding.boxes)]

    @takes(ServerProcessEnded)
    def _process_ended(self, event: ServerProcessEnded) -> list[Instruction]:
        """Its lost connection is an event of its own; but without another one nobody may be left."""
        if not event.replaced:
            self._given_up.add(event.process)
        if event.replaced or (self.holding.phase != Phase.GATHERING and self._some_are_left()):
            return []
        return self._fail(PeerLost(event.cause))

    @takes(ServersMissing)
    def _missing(self, event: ServersMissing) -> list[Instruction]:
        gathers = self.holding.phase is Phase.GATHERING
        if gathers and not self.servers.all_are_known:  # they may be all that is needed; this is told again
            return []
        if not self._some_are_left():
            return self._fail(PeerLost(event.cause)) if event.given_up else []
        return self.gathering.begin_without(event.cause) if gathers else []

    @takes(NobodyJoined)
    def _nobody_joined(self, event: NobodyJoined) -> list[Instruction]:
        """The session ends, unless all that it has lost is a server that it had no use for yet."""
        if self._some_are_left() or not any(server.lost for server in self.servers.states.values()):
            return []
        return self._fail(PeerLost(event.cause))

    @takes(ServingFailed)
    def _serving_failed(self, event: ServingFailed) -> list[Instruction]:
        """Others draw without it; one that is started in its place would be served as little."""
        lost = self._lose(event.server, event.cause)
        if self._some_are_left():
            return lost
        return self._fail(VolsplatError(f"the session cannot go on: {event.cause}"))

    def _some_are_left(self) -> bool:
        """Of both kinds: they can draw by themselves."""
        servers = self.servers
        if self.holding.phase is Phase.GATHERING:
            return all(map(servers.ready, (Role.MAPSHADE_SERVER, Role.SPLAT_SERVER)))
        return bool(servers.splat_servers and (servers.chosen or servers.idle()))

    # -- what servers say

    @takes(MessageReceived)
    def _received(self, event: MessageReceived) -> list[Instruction]:
        if event.server not in self.servers.joined:
            return []  # it counts as lost
        owner, handler = self._handlers[type(event.message)]
        if owner is self.holding and self.holding.outdated(event.message):
            return []
        try:
            _check_phase(event.message, self.holding.phase, handler)
            told: list[Instruction] = handler.method(owner, event.message, event)
        except RemoteProtocolError as error:
            return self._cut_off(event.server, str(error))
        except VolsplatError as error:
            return self._fail(error)
        return told

    def _cut_off(self, server: int, fault: str) -> list[Instruction]:
        """A server that says what cannot be is lost; the session goes on where it does after any other loss."""
        cause = f"{self.servers.name(server)} broke the protocol: {fault}"
        return [CutOff(server, cause), *self._lose(server, cause)]

    @takes(VolumeDescribed, Phase.DESCRIBING)
    def _volume_described(self, message: VolumeDescribed, event: MessageReceived) -> list[Instruction]:
        """Have every server that is to hold a part of the volume link to the splat servers, and the volume read."""
        told = self.holding.described(message, event.payload)
        boxes = self.holding.boxes
        self.servers.workers = [*boxes]
        return [*self.routes.invite(boxes), *self.routes.connect(boxes), *told]

    @takes(ConnectedToSplatServers)
    def _connected(self, message: ConnectedToSplatServers, event: MessageReceived) -> list[Instruction]:
        worker, told = event.server, list[Instruction]()
        for splat in self.routes.connected(worker, message.servers):
            if self.servers.joined.keys() >= {worker, splat}:
                told += self._part(worker, splat, worker)
        return told

    @takes(Refused)
    def _refused(self, message: Refused, event: MessageReceived) -> list[Instruction]:
        joined = self.servers.joined[event.server]
        cause = f"{joined.name}: {message.cause}" if joined.elsewhere else message.cause
        error = PeerLost(cause) if message.reason is Reason.PEER_LOST else BadInput(cause)
        if message.question:
            return [told for questions in self._questions for told in questions.refused(message.question, error)]
        if message.frame:
            return self.frames.end(error) if self.frames.current(message.frame) else []
        if message.request == ReadAhead.__name__:
            return self.sharing.ahead_refused(event.server, str(error))
        if message.request == ConnectToSplatServers.__name__:
            return self._link_refused(event.server, error)
        if message.assignment and message.assignment != self.holding.assignments.newest:
            return []  # who waits now has asked since
        if self.holding.volume is None:
            return self._unsurveyed_refused(event.server, message, error)
        return self._assignment_refused(event.server, message, error) if message.assignment else self._fail(error)

    def _link_refused(self, server: int, error: VolsplatError) -> list[Instruction]:
        """It reaches no splat server; the others may, of whom perhaps none has said so yet."""
        if not self.routes.refused(server):
            return []  # it has been told since whom it can reach
        cause = f"{error}{self.routes.cure(server, error)}"
        if server not in self.holding.boxes or len(self.holding.boxes) == 1:
            return self._fail(PeerLost(cause) if isinstance(error, PeerLost) else BadInput(cause))
        self.servers.note_unlinked(server)
        if not self.routes.some_are_linked(self.holding.boxes):
            self.servers.doubt_heirs(server)
        return self._send_off(server, cause)

    def _unsurveyed_refused(self, server: int, message: Refused, error: VolsplatError) -> list[Instruction]:
        """Without a survey there is nothing to draw; but for what one has no room for others may have some."""
        if message.reason is not Reason.NO_ROOM or len(self.servers.chosen) <= 1:
            return self._fail(error)
        return self._send_off(server, f"{self.servers.name(server)}: {message.cause}")

    def _assignment_refused(self, server: int, message: Refused, error: VolsplatError) -> list[Instruction]:
        """Whoever waits for it is told, and the session goes on."""
        if not self.holding.refused(server, message.request, message.held, error):
            return []
        waiting = [one.asked.question for one in self.voxel_questions.waiting()]
        ended = [told for question in waiting for told in self.voxel_questions.refused(question, error)]
        return [*self.frames.end(error), *ended]

    @takes(FrameFinished, *SURVEYED_PHASES)
    def _frame_finished(self, message: FrameFinished, event: MessageReceived) -> list[Instruction]:
        splat = event.server
        return self._link_anew([(worker, splat) for worker in self.frames.finished(message, event)], splat)

    @takes(FrameMapped, *SURVEYED_PHASES)
    def _frame_mapped(self, message: FrameMapped, event: MessageReceived) -> list[Instruction]:
        worker = event.server
        told = self._link_anew([(worker, splat) for splat in self.frames.mapped(message, worker)], worker)
        return told or self.frames.publish()

    def _link_anew(self, ended: Iterable[tuple[int, int]], teller: int) -> list[Instruction]:
        """Have links of workers and splat servers made anew, and the frame drawn again; unless that has not helped."""
        links = [link for link in ended if self.servers.joined.keys() >= {*link}]
        if not links:
            return []
        if hopeless := [link for link in links if not self.routes.may_link_anew(*link)]:
            return self._part(*hopeless[0], teller)
        told = [told for link in links for told in self.routes.link_anew(*link)]
        return [*self.frames.end(ImageIncomplete("a data link between two servers has ended")), *told]

    def _part(self, worker: int, splat: int, teller: int) -> list[Instruction]:
        """Go on without the one that the other misses, unless that is the only one of its kind and the other is not."""
        missed = splat if teller == worker else worker
        alone = {splat: len(self.servers.splat_servers) == 1, worker: len(self.holding.boxes) == 1}
        lost = teller if alone[missed] and not alone[teller] else missed
        if lost == worker:
            self.servers.note_unlinked(worker)
        cause = self.routes.why_apart(worker, splat, lost)
        if alone[lost] and self.servers.joined[lost].by_hand:  # another one, started alike, would fare alike
            return self._fail(PeerLost(cause))
        return self._send_off(lost, cause)

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken, between two events."""
        if self.failure is not None:
            assert self.frames.frame is None, "a frame runs in a session that has failed"
            return
        self.servers.validate_state()
        self.holding.validate_state()
        self.frames.validate_state()
        self.voxel_questions.validate_state(self.sharing.heals)
        self.file_questions.validate_state()
        self.folders.validate_state()
        self.sharing.validate_state()
        assert self.holding.boxes.keys() <= self.servers.joined.keys(), "a server that is gone holds a part"
        if self.holding.volume is not None:
            may_read = self.servers.idle() and self.frames.idle and self.holding.assignments.may_move
            rests = self.holding.settled and not self.holding.boxes
            assert not (rests and may_read), "nobody reads what all have lost"
            waits = self.frames.idle and self.frames.may_be_whole and self.holding.assignments.may_move
            lacks = self.holding.settled and self.holding.boxes and self.servers.missing and waits
            assert not lacks or self.sharing.ahead.under_way, "nobody reads what was lost"


def _check_phase(message: Message, phase: Phase, handler: Handler) -> None:
    if handler.states and phase not in handler.states:
        raise RemoteProtocolError(f"{type(message).__name__} came while the volume is {phase.value}")


OWNERS = (
    Coordinator,
    Gathering,
    VolumeHolding,
    Frames,
    VoxelQuestions,
    FileVoxelQuestions,
    FolderListings,
    ReadingAhead,
)

OF_TRACES = frozenset({ClockRead, FrameTraced})  # see client/trace
OF_DOCTOR = frozenset({LinkMeasured})  # see deploy/doctor
TAKEN = taken_by(Role.CLIENT) - OF_TRACES - OF_DOCTOR | {*get_args(Event)}

check_handlers(TAKEN, *OWNERS)
