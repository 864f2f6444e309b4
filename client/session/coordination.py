"""The coordinator at work: what is told it, and what it decides, carried out on a thread of its own."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace

import msgspec

from volsplat.client.coordinator.coordinator import Coordinator
from volsplat.client.coordinator.events.events import AbortAsked, Event, Question
from volsplat.client.coordinator.events.instructions import (
    CutOff,
    EndFrame,
    FailSession,
    Found,
    GiveAnswer,
    Instruction,
    PublishImage,
    PublishVolume,
    ReportLoss,
    ReportProgress,
    Send,
)
from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.session.asked_frames import AskedFrames
from volsplat.client.session.late_answers import LateAnswers
from volsplat.client.session.links.server_links import ServerLinks
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.messages.messages import EndSession, RenderFrame
from volsplat.protocol.text.errors import BadInput, PeerLost, VolsplatError

log = logging.getLogger(__name__)


class Coordination:
    """Any thread may tell events, ask and wait; `on_progress` and `on_loss` are called on the coordinator's thread.

    What they raise is logged, and the session goes on.
    """

    def __init__(
        self,
        tracer: FrameTracer | None,
        on_progress: Callable[[str], None],
        on_loss: Callable[[str], None],
        on_failure: Callable[[], None],
    ) -> None:
        """`on_failure` is called by any thread, perhaps more than once."""
        self.frames = AskedFrames()
        self._tracer = tracer
        self._on_progress, self._on_loss, self._on_failure = on_progress, on_loss, on_failure
        self._events: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._coordinator = Coordinator()  # the thread's; others may look at its server_states
        self._answers = LateAnswers()
        self._volume: SurveyedVolume | None = None
        self._failure: VolsplatError | None = None
        self._volume_known = threading.Event()  # set when one of these two is
        self._planned = 0  # the newest frame of which the trace has the plan
        self._another = False  # whether servers are to look for one more session at the end
        self._has_left = False  # the servers were taken leave of
        self._links: ServerLinks | None = None
        self._thread: threading.Thread | None = None

    def begin(self, links: ServerLinks) -> None:
        """Hear what was told and will be, and send to these servers."""
        self._links = links
        self._thread = threading.Thread(target=self._coordinate, args=(links,), name="coordinator", daemon=True)
        self._thread.start()

    def end(self, another: bool) -> None:
        """Take leave of the servers; with `another` they look for one more session at the same address."""
        self._another = another
        self._events.put(None)
        if self.is_here and self._links is not None:
            self._take_leave(self._links)
        elif self._thread is not None:
            self._thread.join()

    @property
    def is_here(self) -> bool:
        """Whether this is the coordinator's thread, for whose work nobody can wait on it."""
        return threading.current_thread() is self._thread

    def check_may_wait(self) -> None:
        """Raises BadInput on the coordinator's thread."""
        if self.is_here:
            raise BadInput(
                "on_progress and on_loss are called on the session's own thread, which would wait for itself; hand "
                "this to another thread"
            )

    def tell(self, event: Event) -> None:
        """What has happened, or is asked for."""
        self._events.put(event)

    @property
    def servers(self) -> list[ServerState]:
        """Every server that has joined, as it stands, those that were lost included."""
        return list(self._coordinator.server_states.values())

    @property
    def failure(self) -> VolsplatError | None:
        """What ended the session, None as long as it goes on."""
        return self._failure

    @property
    def volume(self) -> SurveyedVolume:
        """What is known of the volume; waits until every server has read its sub-cube, or the session has failed."""
        if not self._volume_known.is_set():
            self.check_may_wait()
            self._volume_known.wait()
        if self._volume is None:
            raise self._failure or PeerLost("the session is closed")
        return self._volume

    def ask(self, question: Callable[[int], Question]) -> Future[Found]:
        """Where the answer will be to a question, given its number. Raises BadInput where nobody may wait for it."""
        self.check_may_wait()
        number, answer = self._answers.ask()
        self.tell(question(number))
        return answer

    def abort(self) -> None:
        """Abort what runs; whoever waits for it gets FrameGivenUp once every server has acknowledged."""
        self.tell(AbortAsked(self.frames.supersede()))

    def fail(self, error: VolsplatError) -> None:
        """From now on whoever waits, or asks, gets this error, unless the session has failed before."""
        self._failure = self._failure or error
        self.frames.fail(error)
        self._answers.fail(error)
        self._volume_known.set()
        self._on_failure()

    def _coordinate(self, links: ServerLinks) -> None:
        try:
            while not self._has_left and (event := self._events.get()) is not None:
                began = time.perf_counter()
                for instruction in self._coordinator.handle(event):
                    if not self._has_left:  # `on_progress` or `on_loss` may have ended it
                        self._carry_out(self._traced(instruction, began), links)
        except Exception as error:  # an internal error: whoever waits must hear of it
            self.fail(VolsplatError(f"the session cannot go on: {type(error).__name__}: {error}"))
            log.exception("the session cannot go on")  # which can fail as well
        finally:
            self._take_leave(links)

    def _take_leave(self, links: ServerLinks) -> None:
        if not self._has_left:
            self._has_left = True
            links.take_leave(EndSession(another=self._another))

    def _traced(self, instruction: Instruction, began: float) -> Instruction:
        """As it is, or with the wish that it be traced, where it begins a frame that was planned since a moment."""
        if self._tracer is None or not isinstance(instruction, Send):
            return instruction
        if isinstance(request := instruction.message, RenderFrame):
            if request.frame != self._planned:
                self._planned = request.frame
                self._tracer.note(request.frame, "coordinator", "plan", began, time.perf_counter())
            return replace(instruction, message=msgspec.structs.replace(request, traced=True))
        return instruction

    def _carry_out(self, instruction: Instruction, links: ServerLinks) -> None:
        match instruction:
            case Send(server, message, payload):
                links.send(server, message, payload)
            case CutOff(server, cause):
                links.cut_off(server, cause)
            case ReportProgress(text):
                _tell_caller(self._on_progress, text)
            case ReportLoss(text):
                _tell_caller(self._on_progress, text)
                _tell_caller(self._on_loss, text)
            case PublishVolume(volume):
                self._volume = volume
                self._volume_known.set()
            case PublishImage() | EndFrame():
                self.frames.give(instruction)
            case GiveAnswer():
                self._answers.give(instruction)
            case FailSession(error):
                self.fail(error)


def _tell_caller(tell: Callable[[str], None], text: str) -> None:
    try:
        tell(text)
    except Exception:  # it is a stranger's
        log.exception("on_progress or on_loss has failed at: %s", text)
