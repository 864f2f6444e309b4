"""Answers to questions about points and voxels on their way to the threads that wait for them."""

import threading
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Generic, TypeVar

from volsplat.protocol.text.errors import VolsplatError

Answer = TypeVar("Answer")


class LateAnswers(Generic[Answer]):
    """Those of one kind of question. Any thread may ask and wait; others give the answers."""

    def __init__(self, numbers: Iterator[int]) -> None:
        """`numbers` are those that questions get, of this kind and of others."""
        self._lock = threading.Lock()  # guards what follows
        self._waiting: dict[int, Future[Answer | None]] = {}
        self._numbers = numbers
        self._failure: VolsplatError | None = None

    def ask(self) -> tuple[int, Future[Answer | None]]:
        """A new question's number, and where its answer will be."""
        answer: Future[Answer | None] = Future()
        with self._lock:
            number = next(self._numbers)
            if self._failure is not None:
                answer.set_exception(self._failure)
            else:
                self._waiting[number] = answer
            return number, answer

    def give(self, number: int, found: Answer | None, error: VolsplatError | None) -> None:
        """What was asked by this number is known, or why it will not be."""
        with self._lock:
            answer = self._waiting.pop(number, None)
        if answer is None:
            return  # the session has failed
        if error is None:
            answer.set_result(found)
        else:
            answer.set_exception(error)

    def fail(self, error: VolsplatError) -> None:
        """From now on every question ends in an error."""
        with self._lock:
            self._failure = self._failure or error
            waiting = list(self._waiting)
        for number in waiting:
            self.give(number, None, error)
