"""Images of frames that servers draw: finished ones, and steps of refinement with the partial images between."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager

from volsplat.client.caller.arguments import checked_scene
from volsplat.client.coordinator.events.events import AbortAsked, FrameAsked, PartialImageAsked, ProgressAsked
from volsplat.client.coordinator.events.instructions import PublishImage
from volsplat.client.coordinator.server_states import ImageIncomplete, VolumeIncomplete
from volsplat.client.session.asked_frames import Answers, FrameGivenUp, next_image
from volsplat.client.session.coordination import Coordination
from volsplat.client.session.frame_counts import count_outcome
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import PROGRESS_SECONDS, PartialPace, Refinement, StepOutcome, refined
from volsplat.client.session.turns import Turn, Urgency
from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.program.counts import Counts
from volsplat.program.room_for_image import check_room_for_image
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning

log = logging.getLogger(__name__)


class AskedImages:
    """Each is asked for by the thread that waits for it; what is asked for later takes the place of what runs.

    What viewers of the session draw in turn takes no script's place, and never ends what a script asked for.
    """

    def __init__(self, coordination: Coordination, session: str, counts: Counts, tracer: FrameTracer | None) -> None:
        """`session` is its name in logs."""
        self._coordination = coordination
        self._session = session
        self._counts = counts
        self._tracer = tracer

    def turn(self) -> DrawingTurn:
        """For one who draws in turn."""
        return DrawingTurn(self, self._coordination)

    def finish(self, scene: Scene, step: Step, turn: Turn | None = None) -> Refinement:
        """The finished image of one step; drawn anew if a server was lost whose work others take over."""
        frame: int | None = None
        lost_at: float | None = None
        while True:
            frame, answers = self._ask(scene, step, require_complete=True, after=frame, turn=turn, lost_at=lost_at)
            try:
                *_, finished = self._drawn(frame, answers, step, partial_interval=math.inf)
                return finished
            except ImageIncomplete:  # others take over
                continue
            except FrameGivenUp:  # a viewer went first: once more, if wanted
                lost_at = lost_at or time.monotonic()

    def refine(
        self,
        scene: Scene,
        first: Step,
        last: Step,
        partial_interval: float,
        exact: Collection[Step],
        thinning: Thinning,
    ) -> Iterator[Refinement]:
        """As Session.refine."""
        asked: list[int] = []  # the newest frame of this refinement

        def drawn(step: Step) -> Iterator[Refinement]:
            return self.draw(scene, step, partial_interval, step in exact, thinning, asked)

        return refined(drawn, scene, first, last)

    def draw(
        self,
        scene: Scene,
        step: Step,
        partial_interval: float,
        exact: bool,
        thinning: Thinning,
        asked: list[int],
        turn: Turn | None = None,
    ) -> Iterator[Refinement]:
        """Partial images of the bare buffer, then the finished one. The frames `asked` for are added there.

        Raises FrameGivenUp if it gave way.
        """
        healing = False  # what is left has been seen, and others read the rest: wait for the whole
        lost_at: float | None = None
        while True:
            after = asked[-1] if asked else None
            frame, answers = self._ask(scene, step, healing, after, exact, thinning, turn, lost_at)
            asked.append(frame)
            healing = False
            try:
                for refinement in self._drawn(frame, answers, step, partial_interval):
                    healing = refinement.outcome is not None and refinement.outcome.servers.healing
                    yield refinement
                if not healing:
                    return
            except (ImageIncomplete, VolumeIncomplete):  # lost while it was drawn: once more, with what is left
                continue
            except FrameGivenUp:  # somebody went first: once more, if wanted
                lost_at = lost_at or time.monotonic()

    def _ask(
        self,
        scene: Scene,
        step: Step,
        require_complete: bool,
        after: int | None = None,
        exact: bool = True,
        thinning: Thinning = ALL_VOXELS,
        turn: Turn | None = None,
        lost_at: float | None = None,
    ) -> tuple[int, Answers]:
        """Ask for a frame, which gave way first at that moment.

        Raises FrameGivenUp if something else was asked for since frame `after` or the turn is lost, and BadInput.
        """
        self._coordination.check_may_wait()
        check_room_for_image(scene.image.width, scene.image.height)
        frame, answers = self._coordination.frames.ask(after, turn, lost_at)
        try:
            self._coordination.tell(FrameAsked(frame, scene, step, require_complete, exact, thinning))
            if turn is not None and turn.over:  # since the number was given
                self._coordination.tell(AbortAsked(frame))
            self._log("frame_asked", f"frame {frame}, step {step}, is asked for", frame)
        except BaseException:  # as Ctrl-C is: viewers would wait for what nobody draws
            self._forget(frame)
            raise
        return frame, answers

    def _forget(self, frame: int) -> None:
        """Nobody wants it any more, and nobody need draw it on."""
        self._coordination.frames.forget(frame)
        self._coordination.tell(AbortAsked(frame))

    def _drawn(self, frame: int, answers: Answers, step: Step, partial_interval: float) -> Iterator[Refinement]:
        """Partial images of the bare buffer, then the finished one."""
        started = time.perf_counter()
        try:
            finished = yield from self._until_finished(frame, answers, step, partial_interval)
        finally:
            self._forget(frame)  # also if the caller stopped asking for more images
        image = _published(finished)
        now = time.perf_counter()
        outcome = _outcome(step, finished, started, now)
        count_outcome(self._counts, outcome)
        self._log("frame_finished", f"frame {frame} is here after {now - started:.3f} s", frame)
        if self._tracer is not None:
            self._tracer.note(frame, "caller", f"frame {frame}, step {step}", started, now)
            self._tracer.finish(frame)
        yield Refinement(step, image, outcome)

    def _until_finished(
        self, frame: int, answers: Answers, step: Step, partial_interval: float
    ) -> Generator[Refinement, None, PublishImage]:
        """Partial images that are worth showing; returns the finished one."""
        pace, now = PartialPace(step, partial_interval), time.monotonic()
        look_at, ask_at = now + pace.patience, now + PROGRESS_SECONDS
        while (answer := next_image(answers, max(0.0, min(look_at, ask_at) - now))) is None or answer.outcome is None:
            now = time.monotonic()
            if answer is not None:
                published = _published(answer)
                if pace.shows(published, answer.missing):
                    yield Refinement(step, published, None, answer.missing)
                now = time.monotonic()
                look_at = now + pace.patience
            elif now >= look_at:
                self._coordination.tell(PartialImageAsked(frame))
                look_at = math.inf  # one request at a time: its image or the finished one will come
            elif now >= ask_at:
                self._coordination.tell(ProgressAsked(frame))
                ask_at = now + PROGRESS_SECONDS
        return answer

    def _log(self, event: str, line: str, frame: int) -> None:
        log.info("%s", line, extra={"event": event, "session": self._session, "frame": frame})


class DrawingTurn:
    """One viewer's leave to draw with a session that others draw with as well; it may be taken more than once."""

    def __init__(self, images: AskedImages, coordination: Coordination) -> None:
        self._images = images
        self._coordination = coordination
        self._turn = Turn()

    @property
    def over(self) -> bool:
        """Whether it was ended, by who has it."""
        return self._turn.over

    @contextmanager
    def taken(self, urgency: Urgency, lost_at: float | None = None) -> Iterator[None]:
        """Entered once it has come; `lost_at` is when turns for the same picture were first lost.

        Raises FrameGivenUp if it was ended before, and what ended the session.
        """
        self._coordination.check_may_wait()
        self._coordination.frames.begin_turn(self._turn, urgency, lost_at)
        try:
            yield
        finally:
            self._coordination.frames.leave_turn(self._turn)

    def draw(
        self, scene: Scene, step: Step, partial_interval: float, exact: bool = True, thinning: Thinning = ALL_VOXELS
    ) -> Iterator[Refinement]:
        """One step as Session.refine has it, over the bare buffer. Raises FrameGivenUp if the turn is lost or ended."""
        return self._images.draw(checked_scene(scene), step, partial_interval, exact, thinning, [], self._turn)

    def finish(self, scene: Scene, step: Step) -> Refinement:
        """As Session.finish. Raises FrameGivenUp if the turn is lost or ended."""
        return self._images.finish(checked_scene(scene), step, self._turn)

    def end(self) -> None:
        """Give it back, from any thread: what is drawn in it is aborted."""
        self._coordination.frames.end_turn(self._turn)
        if self._turn.frame is not None:
            self._coordination.tell(AbortAsked(self._turn.frame))


def _published(image: PublishImage) -> PublishedImage:
    return PublishedImage.of_parts(image.parts, image.width, image.height)


def _outcome(step: Step, finished: PublishImage, started: float, now: float) -> StepOutcome:
    """Of an image that was asked for when it `started`, and is here now."""
    assert finished.outcome is not None, "a finished image has one"
    reads = {part.server: part.read for part in finished.parts}
    return StepOutcome(step, now - started, now - finished.drawn_at, finished.outcome, reads)
