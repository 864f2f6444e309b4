"""Tasks of one kind, given out to Dask's workers: as many as keep them busy, and anew if one is late."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from distributed import Future

from volsplat.deploy.batch.dask_workers import LOOK_SECONDS, DaskWorkers, Meanwhile

TASKS_OF_A_THREAD = 2  # one of which waits, so that no thread does
LATE = 4.0  # times what any task took, and no sooner than …
LATE_SECONDS = 10.0
IDLE_LOOKS = 3  # at which no worker has a task, until the person is told

Result = TypeVar("Result")


@dataclass(eq=False)
class Attempt:
    """A task that has been given out, again each time that it was late."""

    task: Callable[[], Any]
    futures: list[Future[Any]] = field(default_factory=list)
    begun: list[float] = field(default_factory=list)  # when each was given out


@dataclass
class Experience:
    """How long the longest task took of any that is over, in seconds."""

    longest: float | None = None

    def add(self, seconds: float) -> None:
        self.longest = max(self.longest or 0.0, seconds)

    def is_late(self, seconds: float) -> bool:
        return self.longest is not None and seconds > max(LATE * self.longest, LATE_SECONDS)


class TaskRun(Generic[Result]):
    def __init__(
        self, workers: DaskWorkers, experience: Experience, report: Callable[[str], None], meanwhile: Meanwhile
    ) -> None:
        self._workers = workers
        self._experience = experience
        self._report = report
        self._meanwhile = meanwhile
        self._over: SimpleQueue[Future[Result]] = SimpleQueue()
        self._idle_looks = 0
        self._attempts: dict[object, Attempt] = {}  # by the key of each of its futures

    @property
    def is_over(self) -> bool:
        return not self._attempts

    @property
    def room(self) -> int:
        """For so many tasks more; for one until a worker is there."""
        return max(0, max(1, self._workers.threads * TASKS_OF_A_THREAD) - len(set(self._attempts.values())))

    def begin(self, tasks: Iterable[Callable[[], Result]]) -> None:
        for task in tasks:
            self._give_out(Attempt(task))

    def next_result(self) -> Result:
        return self._workers.gathered(self._next_over(), self._meanwhile)

    def call_off(self) -> None:
        self._workers.cancel([future for attempt in set(self._attempts.values()) for future in attempt.futures])

    def _give_out(self, attempt: Attempt) -> None:
        future = self._workers.submitted(attempt.task)
        attempt.futures.append(future)
        attempt.begun.append(time.monotonic())
        self._attempts[future.key] = attempt
        future.add_done_callback(self._over.put)

    def _next_over(self) -> Future[Result]:
        """The first future of an attempt that is over; its others are called off."""
        while True:
            try:
                future = self._over.get(timeout=LOOK_SECONDS)
            except Empty:
                self._meanwhile()
                self.look()
                continue
            attempt = self._attempts.get(future.key)
            if attempt is not None:
                self._end(attempt, future)
                return future

    def _end(self, attempt: Attempt, first: Future[Result]) -> None:
        for future in attempt.futures:
            del self._attempts[future.key]
        self._experience.add(time.monotonic() - attempt.begun[attempt.futures.index(first)])
        self._workers.cancel([future for future in attempt.futures if future is not first])

    def look(self) -> None:
        """Sees to what is late. Cheap to call: the scheduler is asked now and then only."""
        if not self._workers.look():
            return
        at_work: dict[object, str] = {
            key: worker for worker, keys in self._workers.tasks.items() for key in keys if key in self._attempts
        }
        self._say_if_idle(not at_work and self._over.empty())
        for attempt in set(self._attempts.values()):
            worker = at_work.get(attempt.futures[-1].key)
            if worker is not None and self._experience.is_late(time.monotonic() - attempt.begun[-1]):
                self._give_to_another(attempt, worker)

    def _give_to_another(self, attempt: Attempt, worker: str) -> None:
        self._workers.avoid(worker)
        if worker not in self._workers.usable:
            self._give_out(attempt)

    def _say_if_idle(self, idle: bool) -> None:
        """Once, if it is so for a while: a task may have ended just now."""
        self._idle_looks = self._idle_looks + 1 if idle else 0
        if self._idle_looks == IDLE_LOOKS:
            self._report(
                "waiting for a worker of Dask's that is free and has the host and resources of the cluster file"
            )
