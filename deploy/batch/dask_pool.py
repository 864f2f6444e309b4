"""The task pool of a Dask cluster: its workers do tasks, and the scheduler has those of a lost worker done anew.

A worker that is slow or frozen is not waited for: what takes it much longer than anything took before is given to
another one too, and the first result counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import version
from itertools import islice
from queue import Empty, SimpleQueue
from typing import TypeVar

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.dask import CONNECT_SECONDS, no_answer, scheduler_of
from volsplat.program.extras import lacking
from volsplat.protocol.text.errors import BadInput

try:
    from distributed import Client, Future

    from volsplat.deploy.batch.dask_tasks import done
    from volsplat.deploy.batch.dask_workers import LOOK_SECONDS, DaskWorkers, Meanwhile
    from volsplat.deploy.batch.task_run import Experience, TaskRun
except ImportError as error:
    raise lacking("distributed", "work by many machines", "dask") from error

CHECK_SECONDS = 10.0  # for a worker that may be at work already
CLOSE_SECONDS = 5.0

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def dask_pool(machines: Sequence[Machine], report: Callable[[str], None]) -> Iterator[DaskPool]:
    """Of the machines' scheduler. Raises BadInput if it does not answer, or a worker has another volsplat."""
    where = scheduler_of(machines[0])
    try:
        client = Client(**where, timeout=CONNECT_SECONDS, set_as_default=False)
    except (TimeoutError, OSError) as error:
        raise no_answer(where, error) from error
    try:
        pool = DaskPool(DaskWorkers(client, machines), report)
        pool.check_versions()
        yield pool
    finally:
        client.close(timeout=CLOSE_SECONDS)


class DaskPool:
    """See program/task_pool.py."""

    def __init__(self, workers: DaskWorkers, report: Callable[[str], None]) -> None:
        self._workers = workers
        self._report = report
        self._experience = Experience()

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
        run: TaskRun[Result] = TaskRun(self._workers, self._experience, self._report, meanwhile)
        waiting = iter(items)
        try:
            while True:
                run.look()
                run.begin(partial(done, partial(task, item)) for item in islice(waiting, run.room))
                if run.is_over:
                    return
                yield run.next_result()
        finally:
            run.call_off()

    def _of_each(self, task: Callable[[], Result], meanwhile: Meanwhile) -> dict[str, Result]:
        """The result of each worker that is there, by its address; those that say nothing are avoided, with a note."""
        self._workers.look()
        futures = {worker: self._workers.submitted(task, worker) for worker in self._workers.usable}
        try:
            _wait_for(list(futures.values()), meanwhile)
            over = {worker: future for worker, future in futures.items() if future.done()}
            found = {worker: self._workers.gathered(future, meanwhile) for worker, future in over.items()}
        finally:
            self._workers.cancel(list(futures.values()))
        for worker in futures.keys() - found.keys():
            self._workers.avoid(worker)
            self._report(f"Dask's worker at {worker} says nothing; going on without it for now")
        return found


def _wait_for(futures: Sequence[Future[Result]], meanwhile: Meanwhile) -> None:
    """Until all are over, but not for long."""
    over: SimpleQueue[Future[Result]] = SimpleQueue()
    for future in futures:
        future.add_done_callback(over.put)
    until = time.monotonic() + CHECK_SECONDS
    while not all(future.done() for future in futures) and time.monotonic() < until:
        with suppress(Empty):
            over.get(timeout=LOOK_SECONDS)
        meanwhile()


def _nothing() -> None:
    """Done meanwhile."""
