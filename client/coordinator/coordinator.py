"""The client's decisions: events in, instructions out. It knows no socket, thread or clock.

An event is something that happened (a server joined, a message came, a person asked for a frame); the answer is a
list of instructions that the session carries out. Handlers are found by name: `_handle_<event>` for events,
`_received_<message>` for messages of servers. Servers may join at any time; those that join after the sub-cubes
were handed out stay idle. Where a map/shade server is lost, the others draw what is left. What a server says in its
turn (see protocol.exchanges) is checked here for what it says: one that tells what cannot be is cut off.
"""

from collections.abc import Iterable
from dataclasses import replace

from volsplat.client.coordinator.coordinator_events import (
    AbortAsked,
    AnswerProbe,
    CutOff,
    EndFrame,
    Event,
    FailSession,
    FrameAsked,
    Instruction,
    MessageReceived,
    PartialImageAsked,
    ProbeAsked,
    PublishImage,
    ReportProgress,
    Send,
    ServerJoined,
    ServerLost,
    ServerProcessEnded,
    VolumeAsked,
)
from volsplat.client.coordinator.frame_request import frame_request
from volsplat.client.coordinator.probes import Probes
from volsplat.client.coordinator.running_frame import RunningFrame
from volsplat.client.coordinator.server_states import ServerState, incomplete, missing_boxes
from volsplat.client.coordinator.volume_holding import Phase, VolumeHolding
from volsplat.protocol.description.scene import Step
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost, RemoteProtocolError, VolsplatError


class Coordinator:
    """The state machine of a session. `handle` is its only door."""

    def __init__(self) -> None:
        self.servers: dict[int, ServerJoined] = {}  # those that are there
        # Those that are there, and those that were lost with a part of the volume; replaced whole, for other threads.
        self.server_states: dict[int, ServerState] = {}
        self.holding = VolumeHolding()
        self.frame: RunningFrame | None = None
        self._probes = Probes()
        self._asked: VolumeAsked | None = None
        self._enlisted_workers: list[int] = []  # those that hold the volume's sub-cubes
        self._splat_server = 0  # the one that draws
        self.failure: VolsplatError | None = None

    def handle(self, event: Event) -> list[Instruction]:
        """Take one event. Raises nothing: what goes wrong is an instruction."""
        if self.failure is not None:
            return self._refused_after_failure(event, self.failure)
        handler = getattr(self, f"_handle_{type(event).__name__}")
        instructions: list[Instruction] = handler(event)
        return instructions

    def _refused_after_failure(self, event: Event, failure: VolsplatError) -> list[Instruction]:
        match event:
            case FrameAsked(frame=frame):
                return [EndFrame(frame, failure)]
            case ProbeAsked(probe=probe):
                return [AnswerProbe(probe, None, failure)]
        return []

    # -- servers come and go

    def _handle_ServerJoined(self, event: ServerJoined) -> list[Instruction]:
        self.servers[event.server] = event
        self._note([ServerState(event.server, event.role, event.host)])
        return self._gathered()

    def _handle_ServerLost(self, event: ServerLost) -> list[Instruction]:
        return self._lose(event.server, event.cause)

    def _lose(self, number: int, cause: str) -> list[Instruction]:
        """Go on without this server where others hold parts of the volume; else the session fails."""
        if self.servers.pop(number, None) is None:
            return []
        if number != self._splat_server and number not in self._enlisted_workers:
            self.server_states = {n: state for n, state in self.server_states.items() if n != number}
            return []
        lost = replace(self.server_states[number], lost=True, cause=cause)
        self._note([lost])
        if self.holding.volume is None or number == self._splat_server or len(self.holding.boxes) == 1:
            return self._fail(PeerLost(cause))
        held = self.holding.lose(number)
        error = incomplete([lost])
        ended = [ReportProgress(str(error)), *self._end_frame(error)]
        return [*ended, *held, *self._go_on(), *self._probes.lost(number)]

    def _note(self, states: Iterable[ServerState]) -> None:
        self.server_states = self.server_states | {state.id: state for state in states}

    def _handle_ServerProcessEnded(self, event: ServerProcessEnded) -> list[Instruction]:
        if self.holding.phase != Phase.GATHERING:
            return []  # its lost connection tells
        return self._fail(PeerLost(event.cause))

    def _handle_VolumeAsked(self, event: VolumeAsked) -> list[Instruction]:
        self._asked = event
        return self._gathered()

    def _gathered(self) -> list[Instruction]:
        asked = self._asked
        if self.holding.phase != Phase.GATHERING or asked is None:
            return []
        workers, splat_servers = self._joined(Role.MAPSHADE_SERVER), self._joined(Role.SPLAT_SERVER)
        if len(workers) < asked.workers or not splat_servers:
            missing = f"{len(workers)} of {asked.workers} map/shade servers, {len(splat_servers)} of 1 splat server"
            return [ReportProgress(f"waiting for servers: {missing} joined")]
        self._enlisted_workers, self._splat_server = workers[: asked.workers], splat_servers[0]
        hosts = {worker: self.servers[worker].host for worker in self._enlisted_workers}
        return self.holding.begin(asked.path, hosts, asked.memory, asked.held)

    def _joined(self, role: Role) -> list[int]:
        return sorted(n for n, server in self.servers.items() if server.role == role)

    # -- the volume, and what servers say of it

    def _handle_MessageReceived(self, event: MessageReceived) -> list[Instruction]:
        if event.server not in self.servers:
            return []  # it counts as lost
        if self.holding.takes(event.message):
            return self._volume_answered(event)
        handler = getattr(self, f"_received_{type(event.message).__name__}")
        instructions: list[Instruction] = handler(event.server, event.message, event)
        return instructions

    def _volume_answered(self, event: MessageReceived) -> list[Instruction]:
        try:
            told = self.holding.received(event.server, event.message, event.payload)
        except RemoteProtocolError as error:
            return self._cut_off(event.server, str(error))
        except VolsplatError as error:
            return self._fail(error)
        if isinstance(event.message, messages.VolumeDescribed):
            return [*self._connect(), *told]
        return [*told, *self._go_on()]

    def _connect(self) -> list[Instruction]:
        """Have every server that is to hold a part of the volume link to the splat server."""
        boxes = self.holding.boxes
        self._note(replace(self.server_states[worker], boxes=tuple(held)) for worker, held in boxes.items())
        data = self.servers[self._splat_server].data
        keys = {worker: self.servers[worker].key for worker in boxes}
        routes = {
            worker: messages.Route(server=self._splat_server, host=data.host, port=data.port, key=key)
            for worker, key in keys.items()
        }
        return [
            Send(self._splat_server, messages.InviteWorkers(keys=keys)),
            *(Send(worker, messages.ConnectToSplatServers(routes=[route])) for worker, route in routes.items()),
        ]

    def _received_ConnectedToSplatServers(
        self, server: int, message: messages.ConnectedToSplatServers, event: MessageReceived
    ) -> list[Instruction]:
        return []

    def _go_on(self) -> list[Instruction]:
        """Begin the frame that waits and send the probes that do, where the servers are ready for them."""
        return [*self._begin_frame(), *self._send_probes()]

    def _received_Refused(self, server: int, message: messages.Refused, event: MessageReceived) -> list[Instruction]:
        joined = self.servers[server]
        cause = f"{joined.name}: {message.cause}" if joined.elsewhere else message.cause
        error = PeerLost(cause) if message.peer_lost else BadInput(cause)
        if message.probe:
            return self._probes.refused(message.probe, error)
        if not message.frame:
            return self._assignment_refused(server, message, error)
        return self._end_frame(error) if self._current(message.frame) else []

    def _assignment_refused(self, server: int, message: messages.Refused, error: VolsplatError) -> list[Instruction]:
        """Whoever waits for what is refused is told; the session goes on once the volume is surveyed."""
        if message.request == messages.ConnectToSplatServers.__name__ and len(self.holding.boxes) > 1:
            if self.holding.volume is not None and server in self.holding.boxes:  # the others can draw
                return [Send(server, messages.EndSession()), *self._lose(server, str(error))]
        if self.holding.volume is None or not message.assignment:
            return self._fail(error)
        if message.assignment != self.holding.newest_assignment:
            return []
        if not self.holding.refused(server, message.request, message.held):
            return self._go_on()  # who waits now has asked since
        waiting = [probe.probe for probe in self._probes.waiting()]
        refused = [told for probe in waiting for told in self._probes.refused(probe, error)]
        return [*self._end_frame(error), *refused, *self._go_on()]

    # -- frames

    def _handle_FrameAsked(self, event: FrameAsked) -> list[Instruction]:
        replaced = self.frame
        self.frame = RunningFrame(event.frame, event.scene, event.step, event.whole)
        begun = self._begin_frame()
        if replaced is None:
            return begun
        # RenderFrame makes every server drop older frames by itself; where it must wait, they are told to stop now.
        waits = self.frame is None or not self.frame.started
        stop = self._abort_everywhere(replaced) if waits and replaced.started else []
        return [*stop, EndFrame(replaced.frame), *begun]

    def _abort_everywhere(self, frame: RunningFrame) -> list[Instruction]:
        return [Send(server, messages.AbortFrame(frame=frame.frame)) for server in self._drawing()]

    def _end_frame(self, error: VolsplatError) -> list[Instruction]:
        """End the frame that runs or waits, if any: because of this error, unless it was being aborted."""
        frame, self.frame = self.frame, None
        if frame is None:
            return []
        if frame.unacknowledged:
            return [EndFrame(frame.frame)]
        stop = self._abort_everywhere(frame) if frame.started else []
        return [*stop, EndFrame(frame.frame, error)]

    def _begin_frame(self) -> list[Instruction]:
        """Send the waiting frame, after packing for its quantisation where that is still to be done."""
        frame = self.frame
        volume = self.holding.volume
        if frame is None or frame.started or volume is None:
            return []
        if frame.whole and missing_boxes(self.server_states.values()):
            return self._end_frame(incomplete(self.server_states.values()))
        geometry = volume.description.geometry
        frame.scene = volume.settled(frame.scene)
        try:
            packing = self.holding.wanted(frame.scene, frame.step, steady=not frame.whole)
            if not self.holding.settled:
                return self.holding.prepare(packing) if self.holding.gives_way(packing) else []
            if not self.holding.holds(packing):
                return self.holding.prepare(packing)
            resolution = self.holding.resolution(frame.step, frame.scene.refine.striding)
            render = frame_request(
                frame.frame,
                self.holding.assignment,
                frame.scene,
                frame.step,
                geometry,
                packing.quantisation,
                resolution,
                list(self.holding.boxes),
            )
        except BadInput as error:
            return self._end_frame(error)
        except ValueError as error:
            return self._end_frame(BadInput(str(error)))
        frame.level, frame.why_level = resolution.level, packing.why_level
        frame.started = True
        partial = self._handle_PartialImageAsked(PartialImageAsked(frame.frame)) if frame.partial_wanted else []
        return [
            ReportProgress(f"step {frame.step}"),
            *(Send(server, render) for server in self._drawing()),
            *partial,
        ]

    def _drawing(self) -> list[int]:
        """The servers of a frame: the splat server last, since all others have work to do before it has any."""
        return [*self.holding.boxes, self._splat_server]

    def _handle_AbortAsked(self, event: AbortAsked) -> list[Instruction]:
        frame = self.frame
        if frame is None or frame.frame != event.frame or frame.unacknowledged:
            return []
        if not frame.started:
            self.frame = None
            return [EndFrame(frame.frame)]
        frame.unacknowledged = set(self._drawing())
        return self._abort_everywhere(frame)

    def _received_FrameAborted(
        self, server: int, message: messages.FrameAborted, event: MessageReceived
    ) -> list[Instruction]:
        frame = self._current(message.frame)
        if frame is None:
            return []
        frame.unacknowledged.discard(server)
        if frame.unacknowledged:
            return []
        self.frame = None
        return [EndFrame(frame.frame)]

    def _handle_PartialImageAsked(self, event: PartialImageAsked) -> list[Instruction]:
        frame = self._current(event.frame)
        if frame is None or frame.unacknowledged or frame.splat is not None:
            return []
        if not frame.started:
            frame.partial_wanted = True
            return []
        return [Send(self._splat_server, messages.ReadImage(frame=event.frame))]

    def _received_FrameMapped(
        self, server: int, message: messages.FrameMapped, event: MessageReceived
    ) -> list[Instruction]:
        frame = self._current(message.frame)
        if frame is None:
            return []
        frame.map_shade[server] = message.stats
        return self._finished(frame)

    def _received_FrameFinished(
        self, server: int, message: messages.FrameFinished, event: MessageReceived
    ) -> list[Instruction]:
        frame = self._current(message.frame)
        if frame is None or frame.unacknowledged:
            return []
        if not message.complete:
            if not message.lost or not set(message.lost) <= set(self.holding.boxes):
                said = f"frame {frame.frame} is incomplete for lack of {message.lost or 'nobody'}"
                return self._cut_off(server, f"{said}, but its workers are {list(self.holding.boxes)}")
            return [instruction for worker in message.lost for instruction in self._dismiss(worker)]
        frame.splat, frame.drawn_at = message.stats, event.at
        return []

    def _dismiss(self, worker: int) -> list[Instruction]:
        """A worker from which the splat server hears no more counts as lost, whether or not it lives."""
        if worker not in self.servers:
            return []
        cause = f"{self.servers[worker].name} has lost its connection to the splat server"
        return [Send(worker, messages.EndSession()), *self._lose(worker, cause)]

    def _cut_off(self, server: int, fault: str) -> list[Instruction]:
        """A server that says what cannot be is lost; the session goes on where it does after any other loss."""
        cause = f"{self.servers[server].name} broke the protocol: {fault}"
        return [CutOff(server, cause), *self._lose(server, cause)]

    def _received_ImageRead(
        self, server: int, message: messages.ImageRead, event: MessageReceived
    ) -> list[Instruction]:
        frame = self._current(message.frame)
        if frame is None:
            return []
        wanted = frame.scene.image
        if (message.width, message.height, message.step) != (wanted.width, wanted.height, frame.step):
            said = f"the image of frame {frame.frame} is step {message.step}, {message.width} x {message.height} pixels"
            return self._cut_off(server, f"{said}, not step {frame.step}, {wanted.width} x {wanted.height}")
        image = PublishImage(
            frame.frame, frame.step, message.width, message.height, event.payload, complete=message.complete
        )
        if not message.complete:
            return [image]
        frame.image = image
        return self._finished(frame)

    def _finished(self, frame: RunningFrame) -> list[Instruction]:
        image = frame.finished(self.holding.boxes, missing_boxes(self.server_states.values()))
        if image is None:
            return []
        self.frame = None
        return [image]

    def _current(self, frame: int) -> RunningFrame | None:
        """The running frame if it has this id; messages of older frames are of no use any more."""
        return self.frame if self.frame is not None and self.frame.frame == frame else None

    def _fail(self, error: VolsplatError) -> list[Instruction]:
        self.failure = error
        frame, self.frame = self.frame, None
        ended: list[Instruction] = [EndFrame(frame.frame, error)] if frame is not None else []
        return [*ended, *self._probes.failed(error), FailSession(error)]

    # -- probes

    def _handle_ProbeAsked(self, event: ProbeAsked) -> list[Instruction]:
        assert self.holding.volume is not None, "who asks knows the volume"
        settled = replace(event, scene=self.holding.volume.settled(event.scene))
        refused = self._probes.add(settled, self.holding.volume.description.geometry)
        return [*refused, *self._send_probes()]

    def _send_probes(self) -> list[Instruction]:
        """Send the probes that wait and can be answered by what is packed; pack for the first that cannot."""
        sent: list[Instruction] = []
        for probe in list(self._probes.waiting()):
            volume, boxes = self.holding.volume, self.holding.boxes
            if volume is None or not self.holding.settled:
                break
            try:
                packing = self.holding.wanted(probe.scene, Step.F, steady=True)
            except BadInput as error:
                sent += self._probes.refused(probe.probe, error)
                continue
            except ValueError as error:
                sent += self._probes.refused(probe.probe, BadInput(str(error)))
                continue
            if self.holding.packing is None or packing.quantisation != self.holding.packing.quantisation:
                return sent + self.holding.prepare(packing)  # any level will do
            geometry = volume.description.geometry
            resolution = self.holding.finest()
            ask = self._probes.request(
                probe, boxes, self.holding.assignment, geometry, packing.quantisation, resolution
            )
            sent += [Send(worker, ask) for worker in boxes]
        return sent

    def _received_VoxelProbed(
        self, server: int, message: messages.VoxelProbed, event: MessageReceived
    ) -> list[Instruction]:
        return self._probes.received(server, message)
