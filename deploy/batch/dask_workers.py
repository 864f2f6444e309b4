"""A Dask cluster's workers as this process sees them: who is there, who may have tasks, and what comes of those."""

from __future__ import annotations

import asyncio
import socket
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import Future as ConcurrentFuture
from contextlib import suppress
from typing import Any, TypeVar
from urllib.parse import urlsplit

from distributed import Client, Future
from distributed.comm.core import CommClosedError
from distributed.scheduler import KilledWorker

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.dask import DASK_SECONDS, scheduler_of
from volsplat.protocol.text.errors import BadInput, VolsplatError

LOOK_SECONDS = 0.5  # between two looks at what the person wants
PULSE_SECONDS = 2.0  # between two questions to the scheduler
AVOIDED_SECONDS = 300.0  # for which a worker that kept others waiting gets nothing; Dask gives up frozen ones by then
CANCEL_SECONDS = 2.0
GO_ON = "the same command goes on from here"

Result = TypeVar("Result")
Meanwhile = Callable[[], None]


class DaskWorkers:
    """Those on the machines of a cluster file; `tasks` says which tasks each has."""

    def __init__(self, client: Client, machines: Sequence[Machine]) -> None:
        self._client = client
        self._hosts = _addresses_of(machines)
        self._resources = dict(machines[0].dask.resources) or None
        self._scheduler = next(iter(scheduler_of(machines[0]).values()))
        self._threads: dict[str, int] = {}  # of each worker
        self._avoided: dict[str, float] = {}  # workers, and until when
        self._looked = 0.0
        self.tasks: dict[str, Sequence[object]] = {}

    @property
    def usable(self) -> list[str]:
        """Those that may be given tasks: all, if all keep others waiting."""
        now = time.monotonic()
        there = [worker for worker in self._threads if self._hosts is None or _host(worker) in self._hosts]
        return [worker for worker in there if self._avoided.get(worker, now) <= now] or there

    @property
    def threads(self) -> int:
        return sum(self._threads[worker] for worker in self.usable)

    def avoid(self, worker: str) -> None:
        self._avoided[worker] = time.monotonic() + AVOIDED_SECONDS

    def look(self) -> bool:
        """Asks the scheduler, unless it was asked just now. Raises VolsplatError if it says nothing."""
        if time.monotonic() - self._looked < PULSE_SECONDS:
            return False
        if self._client.status != "running":
            raise self._lost()
        self._threads = dict(self._asked("ncores"))
        self.tasks = dict(self._asked("processing"))
        self._looked = time.monotonic()
        return True

    def submitted(self, task: Callable[[], Result], worker: str | None = None) -> Future[Result]:
        """Given to this worker, or to any that may have it."""
        name = f"volsplat prepare {uuid.uuid4().hex}"
        return self._client.submit(task, key=name, pure=False, resources=self._resources, workers=self._choice(worker))

    def _choice(self, worker: str | None) -> list[str] | None:
        """None for any, those included that are not there yet."""
        if worker is not None:
            return [worker]
        usable = self.usable
        return usable if usable and (self._hosts is not None or len(usable) < len(self._threads)) else self._hosts

    def gathered(self, future: Future[Result], meanwhile: Meanwhile) -> Result:
        """The result of a future that is over. Raises VolsplatError if its workers were lost, or the scheduler was."""
        gathering = self._begun(self._client.gather(future, asynchronous=True))
        try:
            gathered: Result = _waited_for(gathering, meanwhile)
            return gathered
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
        """Unless the scheduler says nothing, which then cancels them as this process ends."""
        if futures and self._client.status == "running":
            with suppress(TimeoutError, OSError):
                self._begun(self._client.cancel(list(futures), force=True, asynchronous=True)).result(CANCEL_SECONDS)

    def _asked(self, question: str) -> Any:
        ask = getattr(self._client.scheduler, question)
        try:
            return self._begun(ask(workers=None)).result(DASK_SECONDS)
        except (TimeoutError, OSError) as error:
            raise self._lost() from error

    def _begun(self, coroutine: Any) -> ConcurrentFuture[Any]:
        """On the loop of Dask's client, which has a thread of its own."""
        loop: Any = self._client.loop  # Tornado's, which has asyncio's
        return asyncio.run_coroutine_threadsafe(coroutine, loop.asyncio_loop)

    def _lost(self) -> VolsplatError:
        return VolsplatError(f"Dask's scheduler at {self._scheduler} was lost; once it is back, {GO_ON}")


def _waited_for(gathering: ConcurrentFuture[Any], meanwhile: Meanwhile) -> Any:
    while True:
        try:
            return gathering.result(LOOK_SECONDS)
        except TimeoutError:
            if gathering.done():
                raise
            meanwhile()


def _addresses_of(machines: Sequence[Machine]) -> list[str] | None:
    """Of the hosts that the machines name; None if one of them may be any. Raises BadInput for an unknown name."""
    hosts = [machine.host for machine in machines if machine.host is not None]
    if len(hosts) < len(machines):
        return None
    try:
        return [socket.gethostbyname(host) for host in hosts]
    except OSError as error:
        raise BadInput(f"host {', '.join(hosts)}: {error}; give each as this machine knows it") from error


def _host(worker: str) -> str:
    return urlsplit(worker).hostname or ""
