"""Answers to probes on their way to the threads that wait for them."""

import threading
from concurrent.futures import Future

from volsplat.client.coordinator.coordinator_events import AnswerProbe
from volsplat.protocol.messages.messages import ProbedVoxel
from volsplat.protocol.text.errors import VolsplatError

Answer = Future[ProbedVoxel | None]


class ProbeAnswers:
    """Any thread may ask and wait; others give the answers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards what follows
        self._waiting: dict[int, Answer] = {}
        self._newest = 0
        self._failure: VolsplatError | None = None

    def ask(self) -> tuple[int, Answer]:
        """A new probe's number, and where its answer will be."""
        answer: Answer = Future()
        with self._lock:
            self._newest += 1
            if self._failure is not None:
                answer.set_exception(self._failure)
            else:
                self._waiting[self._newest] = answer
            return self._newest, answer

    def give(self, given: AnswerProbe) -> None:
        with self._lock:
            answer = self._waiting.pop(given.probe, None)
        if answer is None:
            return  # the session has failed
        if given.error is None:
            answer.set_result(given.voxel)
        else:
            answer.set_exception(given.error)

    def fail(self, error: VolsplatError) -> None:
        """From now on every probe ends in an error."""
        with self._lock:
            self._failure = self._failure or error
            waiting = list(self._waiting)
        for probe in waiting:
            self.give(AnswerProbe(probe, None, error))
