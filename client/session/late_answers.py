"""Answers to questions about points, voxels and folders on their way to the threads that wait for them."""

import threading
from concurrent.futures import Future
from itertools import count

from volsplat.client.coordinator.events.instructions import Found, GiveAnswer
from volsplat.protocol.text.errors import VolsplatError


class LateAnswers:
    """Of all kinds of question, in one row of numbers. Any thread may ask and wait; others give the answers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards what follows
        self._waiting: dict[int, Future[Found]] = {}
        self._numbers = count(1)
        self._failure: VolsplatError | None = None

    def ask(self) -> tuple[int, Future[Found]]:
        """A new question's number, and where its answer will be."""
        future: Future[Found] = Future()
        with self._lock:
            number = next(self._numbers)
            if self._failure is not None:
                future.set_exception(self._failure)
            else:
                self._waiting[number] = future
            return number, future

    def give(self, answer: GiveAnswer) -> None:
        """What was asked is known, or why it will not be."""
        with self._lock:
            future = self._waiting.pop(answer.question, None)
        if future is None:
            return  # the session has failed
        if answer.error is None:
            future.set_result(answer.found)
        else:
            future.set_exception(answer.error)

    def fail(self, error: VolsplatError) -> None:
        """From now on every question ends in an error."""
        with self._lock:
            self._failure = self._failure or error
            waiting = list(self._waiting)
        for number in waiting:
            self.give(GiveAnswer(number, error=error))
