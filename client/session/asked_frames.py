"""The frames that were asked for, and the images on their way to the threads that wait for them."""

import queue
import threading
import time
from collections.abc import Callable

from volsplat.client.coordinator.events.instructions import EndFrame, PublishImage
from volsplat.client.session.turns import PATIENCE_SECONDS, Turn, Turns, Urgency
from volsplat.protocol.messages.message import LARGEST_ID
from volsplat.protocol.text.callers_lines import under_callers_lines
from volsplat.protocol.text.errors import BadInput, VolsplatError

ASK_AGAIN = "ask again if it is still wanted"

Answers = queue.SimpleQueue[PublishImage | EndFrame]  # to one frame's request


class FrameGivenUp(VolsplatError):
    """The frame was aborted, by `abort` or because a newer one was asked for."""

    _render_traceback_ = under_callers_lines


class AskedFrames:
    """Any thread may ask and wait; the coordinator's answers."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards what follows
        self._answers: dict[int, Answers] = {}
        self._newest = 0
        self._newest_outright = 0  # of those without a turn
        self._aborts = 0
        self._turns = Turns()
        self._failure: VolsplatError | None = None

    @property
    def newest(self) -> int:
        return self._newest

    def ask(
        self, after: int | None = None, turn: Turn | None = None, lost_at: float | None = None
    ) -> tuple[int, Answers]:
        """A new frame's number, and where its answers will be; without a turn others may have to finish theirs first.

        `lost_at` is when it first gave way to somebody's turn, in monotonic's seconds.
        Raises FrameGivenUp if something else was asked for outright since frame `after`, if all was aborted meanwhile,
        or somebody else has the turn, what ended the session, and BadInput.
        """
        answers: Answers = queue.SimpleQueue()
        with self._changed:
            aborts, overdue = self._aborts, False

            def given_up() -> bool:
                return self._given_up(after) or self._aborts != aborts

            if turn is None:
                overdue = self._wait_for_turns(given_up, lost_at)
            if self._failure is not None:
                raise self._failure
            if turn is not None and self._turns.holder is not turn:
                raise FrameGivenUp(f"somebody else's turn to draw has begun; {ASK_AGAIN}")
            if turn is None and given_up():
                raise FrameGivenUp(_why_given_up(after))
            if self._newest >= LARGEST_ID:
                raise BadInput(
                    f"this session has had {LARGEST_ID} frames and has no number for another; open the volume anew"
                )
            self._newest += 1
            self._answers[self._newest] = answers
            self._note(self._newest, turn, overdue)
            return self._newest, answers

    def supersede(self) -> int:
        """Make the newest frame an old one, for a refinement between two steps as well; returns its number."""
        with self._changed:
            self._newest += 1
            self._newest_outright = self._newest
            self._aborts += 1
            self._turns.holder = None
            self._changed.notify_all()
            return self._newest - 1

    def begin_turn(self, turn: Turn, urgency: Urgency, lost_at: float | None) -> None:
        """Wait until it may have the session; `lost_at` as in `ask`, of turns of the same viewer before.

        Raises FrameGivenUp if it is over before, and what ended the session.
        """
        with self._changed:
            self._turns.wait(turn, urgency)
            try:
                self._wait_for_turn(turn, lost_at)
                if self._failure is not None:
                    raise self._failure
                if turn.over:
                    raise FrameGivenUp(f"nobody wants this any more; {ASK_AGAIN}")
                self._turns.begin(turn)
            except BaseException:
                self._turns.leave(turn)
                raise
            finally:
                self._changed.notify_all()

    def leave_turn(self, turn: Turn) -> None:
        """Others may draw."""
        with self._changed:
            self._turns.leave(turn)
            self._changed.notify_all()

    def end_turn(self, turn: Turn) -> None:
        """Have who waits for it, or draws in it, do so no more."""
        with self._changed:
            turn.over = True
            self._turns.leave(turn)
            self._changed.notify_all()

    def forget(self, frame: int) -> None:
        """Nobody waits for this frame any more."""
        with self._changed:
            del self._answers[frame]
            self._end(frame)

    def give(self, answer: PublishImage | EndFrame) -> None:
        with self._changed:
            answers = self._answers.get(answer.frame)
            if isinstance(answer, EndFrame):  # who waits may not look for long
                self._end(answer.frame)
            elif answer.outcome is not None:
                self._turns.finish(answer.frame)
                self._end(answer.frame)
        if answers is not None:
            answers.put(answer)

    def fail(self, error: VolsplatError) -> None:
        """From now on every frame ends in an error."""
        with self._changed:
            self._failure = self._failure or error
            self._changed.notify_all()
            waiting = list(self._answers)
        for frame in waiting:
            self.give(EndFrame(frame, error))

    def _given_up(self, after: int | None) -> bool:
        """Whether nothing more may be asked for outright, after that frame."""
        return self._failure is not None or (after is not None and after < self._newest_outright)

    def _wait_for_turns(self, given_up: Callable[[], bool], lost_at: float | None) -> bool:
        """Let viewers finish theirs; returns whether it gave way for so long that no hand goes before it any more."""
        patience = _patience(lost_at)
        if patience > 0 and self._changed.wait_for(lambda: given_up() or not self._turns.scripts_wait, patience):
            return False
        try:
            with self._turns.script_overdue():
                self._changed.wait_for(lambda: given_up() or not self._turns.overdue_scripts_wait)
        finally:
            self._changed.notify_all()
        return True

    def _wait_for_turn(self, turn: Turn, lost_at: float | None) -> None:
        """Until it may begin, or never will; no hand goes before it any more once it gave way for too long."""

        def decided() -> bool:
            return self._failure is not None or turn.over or self._turns.may_begin(turn)

        if turn.urgency not in (Urgency.MOVING, Urgency.AT_REST):
            patience = _patience(lost_at)
            if patience > 0 and self._changed.wait_for(decided, patience):
                return
            turn.urgency = Urgency.OVERDUE
        self._changed.wait_for(decided)

    def _note(self, frame: int, turn: Turn | None, overdue: bool) -> None:
        """Of what runs, this takes the place."""
        if turn is not None:
            turn.frame = frame
            return
        self._newest_outright = frame
        self._turns.ask_outright(frame, overdue)

    def _end(self, frame: int) -> None:
        self._turns.end(frame)
        self._changed.notify_all()


def _patience(lost_at: float | None) -> float:
    """Seconds that are left of it."""
    return PATIENCE_SECONDS if lost_at is None else lost_at + PATIENCE_SECONDS - time.monotonic()


def _why_given_up(after: int | None) -> str:
    what = "this frame was aborted" if after is None else f"what followed frame {after} gave way to a newer frame"
    return f"{what}; {ASK_AGAIN}"


def next_image(answers: Answers, patience: float) -> PublishImage | None:
    """The next image of a frame, or None after `patience` seconds. Raises what ended it otherwise."""
    try:
        answer = answers.get(timeout=patience)
    except queue.Empty:
        return None
    if isinstance(answer, PublishImage):
        return answer
    raise answer.error or FrameGivenUp(f"frame {answer.frame} was aborted, or gave way to a newer one; {ASK_AGAIN}")
