"""The frames that were asked for, and the images on their way to the threads that wait for them."""

import queue
import threading

from volsplat.client.coordinator.coordinator_events import EndFrame, PublishImage
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
        self._lock = threading.Lock()  # guards what follows
        self._answers: dict[int, Answers] = {}
        self._newest = 0
        self._failure: VolsplatError | None = None

    @property
    def newest(self) -> int:
        return self._newest

    def ask(self, after: int | None = None) -> tuple[int, Answers]:
        """A new frame's number, and where its answers will be.

        Raises FrameGivenUp if something else was asked for since frame `after`, what ended the session, and BadInput.
        """
        answers: Answers = queue.SimpleQueue()
        with self._lock:
            if self._failure is not None:
                raise self._failure
            if after is not None and after != self._newest:
                raise FrameGivenUp(f"what followed frame {after} gave way to a newer frame; {ASK_AGAIN}")
            if self._newest >= LARGEST_ID:
                raise BadInput(
                    f"this session has had {LARGEST_ID} frames and has no number for another; open the volume anew"
                )
            self._newest += 1
            self._answers[self._newest] = answers
            return self._newest, answers

    def supersede(self) -> int:
        """Make the newest frame an old one, for a refinement between two steps as well; returns its number."""
        with self._lock:
            self._newest += 1
            return self._newest - 1

    def forget(self, frame: int) -> None:
        """Nobody waits for this frame any more."""
        with self._lock:
            del self._answers[frame]

    def give(self, answer: PublishImage | EndFrame) -> None:
        with self._lock:
            answers = self._answers.get(answer.frame)
        if answers is not None:
            answers.put(answer)

    def fail(self, error: VolsplatError) -> None:
        """From now on every frame ends in an error."""
        with self._lock:
            self._failure = self._failure or error
            waiting = list(self._answers)
        for frame in waiting:
            self.give(EndFrame(frame, error))


def next_image(answers: Answers, patience: float) -> PublishImage | None:
    """The next image of a frame, or None after `patience` seconds. Raises what ended it otherwise."""
    try:
        answer = answers.get(timeout=patience)
    except queue.Empty:
        return None
    if isinstance(answer, PublishImage):
        return answer
    raise answer.error or FrameGivenUp(f"frame {answer.frame} was aborted, or gave way to a newer one; {ASK_AGAIN}")
