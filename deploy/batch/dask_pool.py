"""The task pool of a Dask cluster: its workers do tasks, and the scheduler has those of a lost worker done anew.

A worker that is slow or frozen is not waited for: what takes it much longer than anything took before is given to
another one too, and the first result counts.
"""

from __future__ import annotations

import asyncio
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from itertools import islice
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.dask import CONNECT_SECONDS, DASK_SECONDS, no_answer, scheduler_of
from volsplat.program.extras import lacking
from volsplat.protocol.text.errors import BadInput, VolsplatError

try:
    from distributed import Client, Future
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    from volsplat.deploy.batch.dask_tasks import done
except ImportError as error:
    raise lacking("distributed", "work by many machines", "dask") from error

LOOK_SECONDS = 0.5  # between two looks at what the person wants
PULSE_SECONDS = 2.0  # between two questions to the scheduler
CHECK_SECONDS = 10.0  # for a worker that may be at work already
TASKS_OF_A_THREAD = 2  # one of which waits, so that no thread does
LATE = 4.0  # times what any task took, and no sooner than …
LATE_SECONDS = 10.0
CLOSE_SECONDS = 5.0
GO_ON = "the same command goes on from here"

Item = TypeVar("Item")
Result = TypeVar("Result")
Meanwhile = Callable[[], None]


@contextmanager
def dask_pool(machines: Sequence[Machine], report: Callable[[str], None]) -> Iterator[DaskPool]:
    """Of the machines' scheduler. Raises BadInput if it does not answer, or a worker has another volsplat."""
    where = scheduler_of(machines[0])
    try:
        client = Client(**where, timeout=CONNECT_SECONDS, set_as_default=False)
    except (TimeoutError, OSError) as error:
        raise no_answer(where, error) from error
    try:
        pool = DaskPool(client, machines, report)
        pool.check_versions()
        yield pool
    finally:
        client.close(timeout=CLOSE_SECONDS)


@dataclass(eq=False)
class Attempt:
    """A task that has been given out, once or more often."""

    task: Callable[[], Any]
    futures: list[Future[Any]]
    begun: float = field(default_factory=time.monotonic)


class DaskPool:
    """See program/task_pool.py."""

    def __init__(self, client: Client, machines: Sequence[Machine], report: Callable[[str], None]) -> None:
        hosts = [machine.host for machine in machines if machine.host is not None]
        self._client = client
        self._workers = hosts if len(hosts) == len(machines) else None  # None: any
        self._resources = dict(machines[0].dask.resources) or None
        self._where = scheduler_of(machines[0])
        self._report = report
        self._threads = 1
        self._was_idle = False

    def check_versions(self) -> None:
        """Raises BadInput if a worker has another volsplat, or none."""
        ours = version("volsplat")
        try:
            theirs = self._of_each(partial(version, "volsplat"), _nothing)
        except ImportError:
            raise BadInput(
                "a worker of Dask's has no volsplat; install it in the Python of scheduler and workers, with [formats]"
            ) from None
        for worker, their in theirs.items():
            if their != ours:
                raise BadInput(
                    f"Dask's worker at {worker} has volsplat {their}, and this is {ours}; install the same on both"
                )

    def on_each(self, task: Callable[[], None], meanwhile: Meanwhile) -> None:
        self._of_each(partial(done, task), meanwhile)

    def results(self, task: Callable[[Item], Result], items: Iterable[Item], meanwhile: Meanwhile) -> Iterator[Result]:
        run: Run[Result] = Run(self, meanwhile)
        waiting = iter(items)
        try:
            while True:
                run.begin(partial(done, partial(task, item)) for item in islice(waiting, run.room))
                if not run.attempts:
                    return
                yield run.next_result()
        finally:
            run.call_off()

    # -- what a run asks for

    @property
    def most_tasks(self) -> int:
        return self._threads * TASKS_OF_A_THREAD

    def submitted(self, task: Callable[[], Result], workers: Sequence[str] | None = None) -> Future[Result]:
        """Given to any worker that may have it, or to one of these."""
        name = f"volsplat prepare {uuid.uuid4().hex}"
        where = self._workers if workers is None else list(workers)
        return self._client.submit(task, key=name, pure=False, resources=self._resources, workers=where)

    def gathered(self, future: Future[Result], meanwhile: Meanwhile) -> Result:
        """The result of a future that is over. Raises VolsplatError if its workers were lost, or the scheduler was."""
        loop: Any = self._client.loop  # Tornado's, which has asyncio's
        waited_for = self._client.gather(future, asynchronous=True)
        gathering = asyncio.run_coroutine_threadsafe(waited_for, loop.asyncio_loop)
        try:
            while True:
                try:
                    result: Result = gathering.result(LOOK_SECONDS)
                    return result
                except TimeoutError:
                    if gathering.done():
                        raise
                    meanwhile()
        except KilledWorker as error:
            raise VolsplatError(
                f"{error.allowed_failures + 1} workers of Dask's were lost one after the other while they did the same "
                f"task, at last {error.last_worker.address}; give them more memory or --memory less; {GO_ON}"
            ) from None
        except (CommClosedError, asyncio.CancelledError) as error:
            raise self._lost() from error
        finally:
            gathering.cancel()

    def cancel(self, futures: Sequence[Future[Any]]) -> None:
        if futures and self._client.status == "running":
            self._client.cancel(list(futures), force=True, asynchronous=False)

    def look(self) -> Mapping[str, Sequence[str]]:
        """Which tasks each worker has. Raises VolsplatError if the scheduler says nothing."""
        if self._client.status != "running":
            raise self._lost()
        self._threads = max(1, sum(self._asked("ncores").values()))
        found: Mapping[str, Sequence[str]] = self._asked("processing")
        return found

    def say_whether_idle(self, idle: bool) -> None:
        if idle and not self._was_idle:
            self._report(
                "waiting for a worker of Dask's that is free and has the host and resources of the cluster file"
            )
        self._was_idle = idle

    def _asked(self, question: str) -> Any:
        ask = getattr(self._client.scheduler, question)
        try:
            return self._client.sync(ask, workers=None, callback_timeout=DASK_SECONDS)
        except (TimeoutError, OSError) as error:
            raise self._lost() from error

    def _lost(self) -> VolsplatError:
        return VolsplatError(
            f"Dask's scheduler at {next(iter(self._where.values()))} was lost; once it is back, {GO_ON}"
        )

    def _of_each(self, task: Callable[[], Result], meanwhile: Meanwhile) -> dict[str, Result]:
        """The result of each worker that is there, by its address; with a note, those left out that say nothing."""
        self.look()
        places = self._workers or list(self._asked("ncores"))
        futures = {place: self.submitted(task, [place]) for place in places}
        over: SimpleQueue[Future[Result]] = SimpleQueue()
        for future in futures.values():
            future.add_done_callback(over.put)
        until = time.monotonic() + CHECK_SECONDS
        left = len(futures)
        while left and time.monotonic() < until:
            try:
                over.get(timeout=LOOK_SECONDS)
                left -= 1
            except Empty:
                meanwhile()
        try:
            found = {place: self.gathered(future, meanwhile) for place, future in futures.items() if future.done()}
        finally:
            self.cancel(list(futures.values()))
        silent = [place for place in futures if place not in found]
        if silent:
            self._report(f"Dask's worker at {silent[0]} and {len(silent) - 1} others say nothing yet; going on without")
        return found


class Run(Generic[Result]):
    """What has been given out of one kind of tasks."""

    def __init__(self, pool: DaskPool, meanwhile: Meanwhile) -> None:
        self._pool = pool
        self._meanwhile = meanwhile
        self._over: SimpleQueue[Future[Result]] = SimpleQueue()
        self._longest: float | None = None  # that any task took
        self._looked = 0.0
        self.attempts: dict[object, Attempt] = {}  # by the key of each of its futures

    @property
    def room(self) -> int:
        return max(0, self._pool.most_tasks - len(self.attempts))

    def begin(self, tasks: Iterable[Callable[[], Result]]) -> None:
        for task in tasks:
            self._follow(Attempt(task, []), self._pool.submitted(task))

    def next_result(self) -> Result:
        return self._pool.gathered(self._next_over(), self._meanwhile)

    def call_off(self) -> None:
        self._pool.cancel([future for attempt in set(self.attempts.values()) for future in attempt.futures])

    def _follow(self, attempt: Attempt, future: Future[Result]) -> None:
        attempt.futures.append(future)
        self.attempts[future.key] = attempt
        future.add_done_callback(self._over.put)

    def _next_over(self) -> Future[Result]:
        """The first future of an attempt that is over; the attempt's others are called off."""
        while True:
            try:
                future = self._over.get(timeout=LOOK_SECONDS)
            except Empty:
                self._meanwhile()
                self._look()
                continue
            attempt = self.attempts.get(future.key)
            if attempt is not None:
                self._end(attempt, future)
                return future

    def _end(self, attempt: Attempt, first: Future[Result]) -> None:
        for future in attempt.futures:
            del self.attempts[future.key]
        self._longest = max(self._longest or 0.0, time.monotonic() - attempt.begun)
        self._pool.cancel([future for future in attempt.futures if future is not first])

    def _look(self) -> None:
        if time.monotonic() - self._looked < PULSE_SECONDS:
            return
        found = self._pool.look()
        self._looked = time.monotonic()
        at_work: dict[object, str] = {
            key: worker for worker, keys in found.items() for key in keys if key in self.attempts
        }
        self._pool.say_whether_idle(not at_work and self._over.empty())
        for attempt in [attempt for attempt in set(self.attempts.values()) if self._is_late(attempt)]:
            worker = at_work.get(attempt.futures[0].key)
            others = [other for other in found if other != worker]
            if worker is not None and others:
                self._follow(attempt, self._pool.submitted(attempt.task, others))

    def _is_late(self, attempt: Attempt) -> bool:
        if self._longest is None or len(attempt.futures) > 1:
            return False
        return time.monotonic() - attempt.begun > max(LATE * self._longest, LATE_SECONDS)


def _nothing() -> None:
    """Done meanwhile."""
