"""The frame that is wanted or drawn, as the coordinator knows it: asked for, sent to the servers, put together."""

from itertools import starmap

from volsplat.client.coordinator.block_depths import BlockDepths, need_depths
from volsplat.client.coordinator.data_routes import DataRoutes
from volsplat.client.coordinator.events.events import (
    AbortAsked,
    FrameAsked,
    MessageReceived,
    PartialImageAsked,
    ProgressAsked,
)
from volsplat.client.coordinator.events.instructions import EndFrame, ImagePart, Instruction, ReportProgress, Send
from volsplat.client.coordinator.hidden_share import HiddenShare
from volsplat.client.coordinator.holding.phase import SURVEYED_PHASES
from volsplat.client.coordinator.holding.volume_holding import VolumeHolding
from volsplat.client.coordinator.running_frame import RunningFrame, progress_words
from volsplat.client.coordinator.server_states import ImageIncomplete, ServerState, incomplete
from volsplat.client.coordinator.servers import Servers
from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.client.coordinator.work_shares import WorkShares
from volsplat.client.volume.computable import computable
from volsplat.protocol.messages.frame_messages import (
    AbortFrame,
    DepthsSummed,
    FrameAborted,
    FrameFinished,
    FrameMapped,
    FrameProgress,
    ReadProgress,
    RenderFrame,
)
from volsplat.protocol.messages.handlers import takes
from volsplat.protocol.messages.image_messages import ImageRead, ReadImage
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.text.errors import BadInput, RemoteProtocolError, VolsplatError


class Frames:
    """One at a time: a newer one ends the one before."""

    def __init__(self, servers: Servers, routes: DataRoutes, holding: VolumeHolding, work: WorkShares) -> None:
        self.frame: RunningFrame | None = None
        self._newest = 0  # of those that were asked for
        self._owed = False  # a screen has not seen yet what is left after a loss
        self._servers = servers
        self._routes = routes
        self._holding = holding
        self._shares = RegionShares()
        self._hidden = HiddenShare()
        self._work = work
        self._depths = BlockDepths()

    @takes(FrameAsked)
    def asked(self, event: FrameAsked) -> list[Instruction]:
        if event.frame < self._newest:  # of two threads that ask at once either may be heard first
            return [EndFrame(event.frame)]
        self._newest = event.frame
        replaced = self.frame
        self.frame = RunningFrame(**vars(event))
        begun = self.begin()
        if replaced is None:
            return begun
        # RenderFrame makes every server drop older frames by itself; if it must wait, they are told to stop now.
        waits = self.frame is None or not self.frame.started
        stop = self._abort_everywhere(replaced) if waits and replaced.started else []
        return [*stop, EndFrame(replaced.frame), *begun]

    def begin(self) -> list[Instruction]:
        """Send the waiting frame, after packing for its quantisation if that is still to be done."""
        frame, holding, volume = self.frame, self._holding, self._holding.volume
        if frame is None or frame.started or volume is None or not all(self._drawing_roles()):
            return []
        if self._routes.linking_anew:
            return []
        if not holding.boxes or (frame.require_complete and self._servers.missing):  # others are about to read it
            return [] if holding.assignments.may_move else self.end(incomplete(self._servers.states.values()))
        frame.scene = volume.settled(frame.scene)
        try:
            volume.check_step(frame.step)
            with computable():
                packing = holding.wanted(frame.scene, frame.step, steady=not frame.require_complete)
                if not (holding.settled and holding.holds(packing)):
                    return holding.prepare(packing) if holding.settled or holding.gives_way(packing) else []
                request = self._request(frame)
        except BadInput as error:
            return self.end(error)
        if need_depths(frame.scene, frame.step):
            if asked := self._depths.ask(request, holding.boxes):
                return [ReportProgress("adding up what dims the light"), *starmap(Send, asked)]
            if self._depths.under_way:
                return []
        frame.start(request, packing.why_level)
        return self._started(frame, request)

    def _request(self, frame: RunningFrame) -> RenderFrame:
        """Of what is held. Raises ValueError where the scene does not fit the volume."""
        holding, servers = self._holding, self._servers
        resolution = holding.resolution(frame.step, frame.scene.refine.striding, frame.thinning)
        drawing = holding.drawing(frame.scene, frame.step, resolution)
        return RenderFrame(
            frame=frame.frame,
            assignment=holding.assignment,
            drawing=drawing,
            workers={worker: servers.states[worker].threads for worker in holding.boxes},
            regions=self._shares.regions(drawing.plan, servers.owners),
            exact=frame.exact,
            paced=self._hidden.much,
        )

    def _started(self, frame: RunningFrame, request: RenderFrame) -> list[Instruction]:
        """Have all servers draw it."""
        dimmed = need_depths(frame.scene, frame.step)
        of_splat_servers = self._depths.dimmed(request, frame.scene.light) if dimmed else request
        partial = self.read_partial(PartialImageAsked(frame.frame)) if frame.partial_wanted else []
        return [
            ReportProgress(f"step {frame.step}"),
            *(Send(worker, request) for worker in self._holding.boxes),
            *(Send(server, of_splat_servers) for server in self._servers.splat_servers),
            *partial,
        ]

    def end(self, error: VolsplatError) -> list[Instruction]:
        """End the frame that runs or waits, if any: because of this error, unless it was being aborted."""
        frame, self.frame = self.frame, None
        if frame is None:
            return []
        left = bool(self._holding.boxes) and isinstance(error, ImageIncomplete)
        self._owed = left and frame.started and not frame.require_complete
        if frame.unacknowledged:
            return [EndFrame(frame.frame)]
        stop = self._abort_everywhere(frame) if frame.started else []
        return [*stop, EndFrame(frame.frame, error)]

    def fail(self, error: VolsplatError) -> list[Instruction]:
        """Nothing more is sent."""
        frame, self.frame = self.frame, None
        return [EndFrame(frame.frame, error)] if frame is not None else []

    @property
    def idle(self) -> bool:
        """No server is at one."""
        return self.frame is None or not self.frame.started

    @property
    def may_be_whole(self) -> bool:
        """What is missing may be read before the next frame is drawn: its asker waits, or has seen what is left."""
        waits = self.frame is not None and self.frame.require_complete
        return waits or not (self._owed and self._holding.boxes)

    def current(self, frame: int) -> RunningFrame | None:
        """The running frame if it has this id; messages of older frames are of no use any more."""
        return self.frame if self.frame is not None and self.frame.frame == frame else None

    def _abort_everywhere(self, frame: RunningFrame) -> list[Instruction]:
        return [Send(server, AbortFrame(frame=frame.frame)) for server in self._drawing()]

    def _drawing_roles(self) -> tuple[bool, bool]:
        """Whether there are map/shade servers and splat servers; where the last one is lost another may come."""
        return bool(self._holding.boxes), bool(self._servers.splat_servers)

    def _drawing(self) -> list[int]:
        """The servers of a frame: splat servers last, since all others have work to do before these have any."""
        return [*self._holding.boxes, *self._servers.splat_servers]

    @takes(DepthsSummed, *SURVEYED_PHASES)
    def _depths_summed(self, message: DepthsSummed, event: MessageReceived) -> list[Instruction]:
        self._depths.take(event.server, message, event.payload)
        return []

    @takes(AbortAsked)
    def abort(self, event: AbortAsked) -> list[Instruction]:
        frame = self.current(event.frame)
        if frame is None or frame.unacknowledged:
            return []
        if not frame.started:
            self.frame = None
            return [EndFrame(frame.frame)]
        frame.unacknowledged = set(self._drawing())
        return self._abort_everywhere(frame)

    @takes(FrameAborted, *SURVEYED_PHASES)
    def _aborted(self, message: FrameAborted, event: MessageReceived) -> list[Instruction]:
        frame = self.current(message.frame)
        if frame is None:
            return []
        return self._acknowledged(frame, event.server)

    def _acknowledged(self, frame: RunningFrame, server: int) -> list[Instruction]:
        """A server does nothing more for a frame that is being aborted."""
        frame.unacknowledged.discard(server)
        if frame.unacknowledged:
            return []
        self.frame = None
        return [EndFrame(frame.frame)]

    @takes(PartialImageAsked)
    def read_partial(self, event: PartialImageAsked) -> list[Instruction]:
        frame = self.current(event.frame)
        if frame is None or frame.unacknowledged:
            return []
        if not frame.started:
            frame.partial_wanted = True
            return []
        frame.awaited = {server for server in frame.rectangles if not frame.done(server)}
        return [Send(server, ReadImage(frame=event.frame)) for server in sorted(frame.awaited - frame.splat.keys())]

    def lose(self, lost: ServerState) -> list[Instruction]:
        """Go on without a splat server. If its part is unfinished the frame ends, and the others' parts are shown."""
        frame = self.frame
        if frame is None or not frame.started:
            return []
        if frame.unacknowledged:
            return self._acknowledged(frame, lost.id)
        frame.asked_how_far.discard(lost.id)
        if lost.id not in frame.rectangles or frame.done(lost.id):
            return []
        shown = frame.left_by(lost.id)
        return [*([shown] if shown else []), *self.end(ImageIncomplete(lost.cause))]

    def mapped(self, message: FrameMapped, worker: int) -> list[int]:
        """Note that a worker has done its part; the splat servers that it does not reach are in the answer.

        Raises RemoteProtocolError unless these are splat servers of the frame.
        """
        frame = self.current(message.frame)
        if frame is None or frame.unacknowledged:
            return []
        if not set(message.lost) <= frame.rectangles.keys():
            said = f"it cannot reach {message.lost} for frame {frame.frame}"
            raise RemoteProtocolError(f"{said}, but its splat servers are {list(frame.rectangles)}")
        frame.map_shade[worker] = message.stats
        return message.lost

    def finished(self, message: FrameFinished, event: MessageReceived) -> list[int]:
        """Note that a part of the image will not change any more; the workers that it lacks are in the answer.

        Raises RemoteProtocolError unless these are workers of the frame, and the sender did its part of it.
        """
        frame, workers = self.current(message.frame), list(self._holding.boxes)
        if frame is None or frame.unacknowledged:
            return []
        if event.server not in frame.rectangles:
            raise RemoteProtocolError(f"it draws nothing of frame {frame.frame}")
        if message.complete:
            frame.check_work(event.server, message.stats)
            frame.splat[event.server], frame.drawn_at = message.stats, event.at
            return []
        if not message.lost or not set(message.lost) <= set(workers):
            said = f"frame {frame.frame} is incomplete for lack of {message.lost or 'nobody'}"
            raise RemoteProtocolError(f"{said}, but its workers are {workers}")
        return message.lost

    @takes(ImageRead, *SURVEYED_PHASES)
    def _image_read(self, message: ImageRead, event: MessageReceived) -> list[Instruction]:
        frame = self.current(message.frame)
        if frame is None:
            return []
        rectangle = Rectangle(message.left, message.top, message.width, message.height)
        asked = frame.rectangles.get(event.server)
        if (rectangle, message.step) != (asked, frame.step):
            shown = f"step {message.step} and {rectangle}, not step {frame.step} and {asked}"
            raise RemoteProtocolError(f"the image of frame {frame.frame} is {shown}")
        partial = frame.take(event.server, ImagePart(event.server, rectangle, event.payload, message), message.complete)
        return [partial] if partial else self.publish()

    @takes(ProgressAsked)
    def read_progress(self, event: ProgressAsked) -> list[Instruction]:
        """One question at a time: who is slow to answer is not asked more often."""
        frame = self.current(event.frame)
        if frame is None or frame.unacknowledged or frame.asked_how_far:
            return []
        frame.asked_how_far = {server for server in frame.rectangles if not frame.done(server)}
        return [Send(server, ReadProgress(frame=event.frame)) for server in sorted(frame.asked_how_far)]

    @takes(FrameProgress, *SURVEYED_PHASES)
    def _progress(self, message: FrameProgress, event: MessageReceived) -> list[Instruction]:
        frame = self.current(message.frame)
        if frame is None or frame.unacknowledged:
            return []
        frame.shares_done[event.server] = message.share
        frame.asked_how_far.discard(event.server)
        if frame.asked_how_far:
            return []
        return [ReportProgress(progress_words(frame.step, frame.share_done))]

    def publish(self) -> list[Instruction]:
        """The finished image, once all is here that comes with it."""
        frame = self.frame
        missing, healing = self._servers.missing, self._holding.assignments.may_move
        image = frame.finished(self._holding.boxes, missing, bool(missing) and healing) if frame is not None else None
        if frame is None or frame.request is None or image is None:
            return []
        self._owed = False
        self._routes.drew_whole()
        self._servers.drew_whole(frame.map_shade)
        self._shares.measured(frame.request, frame.splat)
        self._hidden.measured(frame.request, frame.splat)
        self._work.measured(frame.scene, frame.map_shade, frame.splat, frame.drawn_at)
        self.frame = None
        return [image]

    def validate_state(self) -> None:
        """Raises AssertionError if an invariant is broken."""
        frame = self.frame
        if frame is None:
            return
        if not frame.started:
            others_read = frame.require_complete and self._servers.missing
            ready = self._holding.settled and self._holding.volume and all(self._drawing_roles())
            waits = self._depths.under_way or self._routes.linking_anew
            assert not ready or others_read or waits, "a frame waits though the servers are ready"
            assert not frame.unacknowledged and not frame.map_shade, "a frame that waits has answers"
            return
        assert self._holding.volume is not None, "a frame of an unknown volume runs"
        assert frame.unacknowledged <= set(self._drawing()), "a server that does not draw must acknowledge an abort"
        drawing = {server for server in frame.rectangles if not frame.done(server)}
        assert frame.awaited <= drawing, "a partial image waits for a part that is whole"
        there = set(self._servers.splat_servers)
        assert frame.unacknowledged or frame.asked_how_far <= there, "a server that is gone is asked how far it is"
        gone = drawing - there
        assert frame.unacknowledged or not gone, "a part of the image is awaited of a server that is gone"
        assert frame.map_shade.keys() <= self._holding.boxes.keys(), "a frame counts a server that holds nothing"
        assert frame.finished(self._holding.boxes) is None, "a frame that is whole was not published"
