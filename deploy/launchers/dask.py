"""The launcher `dask`: each server is a task of a Dask cluster, which places it, and again if its worker is lost.

The scheduler keeps the tasks for other commands, as published datasets, and what servers print, as events.
"""

from __future__ import annotations

import asyncio
import shlex
import uuid
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import msgspec

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.home_path import home_path
from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.program.extras import lacking
from volsplat.protocol.text.errors import BadInput

try:
    from distributed import Client, Event, Future
    from distributed.scheduler import KilledWorker

    from volsplat.deploy.launchers.dask_task import BEGUN, LINE, serve
except ImportError as error:
    raise lacking("distributed", "the launcher dask", "dask") from error

DASK_SECONDS = 30.0  # for all that one command asks: a scheduler that is frozen answers nothing
CONNECT_SECONDS = 5
GRACE_SECONDS = 6.0  # that servers have to end before their tasks are forgotten, which a frozen worker needs

OVER = {"memory", "released", "forgotten"}  # states of a task that has returned

Result = TypeVar("Result")


class DaskLauncher:
    def __init__(self, machine: Machine, folder: Path) -> None:
        self._machine = machine
        self._cluster = folder.name

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        report(f"{self._machine.title}: giving {len(orders)} tasks to Dask")

        published: list[StartedServer] = []

        async def submit(client: Client) -> None:
            for order in orders:
                name = f"volsplat {self._cluster} {order.name} {uuid.uuid4().hex[:8]}"
                published.append(StartedServer(order.name, "a task of Dask", {"task": name}))
                await client.publish_dataset(self._submitted(client, order, name, secrets), name=name)

        try:
            self._asked(submit)
        except BaseException:
            with suppress(BadInput):  # a scheduler that is gone knows of none
                if published:
                    self.stop(published, report)
            raise
        return published

    def _submitted(self, client: Client, order: ServerOrder, name: str, secrets: Secrets) -> Future[None]:
        machine = self._machine
        command = "" if machine.command == "volsplat" else machine.command
        return client.submit(
            serve,
            name,
            order.program,
            command,
            order.arguments,
            secrets.token,
            key=name,
            pure=False,
            resources=dict(machine.dask.resources) or None,
            workers=None if machine.host is None else [machine.host],
        )

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        async def ask(client: Client) -> dict[str, Said]:
            assert client.scheduler is not None, "a client that has connected has one"
            tasks = await client.scheduler.get_task_status(keys=[server.handle["task"] for server in servers])
            workers = set(await client.nthreads())
            return {
                server.name: await _said(client, server.handle["task"], tasks[server.handle["task"]], workers)
                for server in servers
            }

        try:
            return self._asked(ask)
        except BadInput as error:
            return {server.name: Said(ServerState.UNKNOWN, str(error)) for server in servers}

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        async def end(client: Client) -> None:
            tasks = [server.handle["task"] for server in servers]
            there = set(await client.list_datasets()) & set(tasks)
            futures = [await client.get_dataset(task) for task in tasks if task in there]
            for future in futures:
                await Event(future.key, client=client).set()
            await _over(futures)
            await client.cancel(futures, force=True)
            for future in futures:
                await client.unpublish_dataset(future.key)

        self._asked(end)

    def logs(self, server: StartedServer, lines: int) -> str:
        async def ask(client: Client) -> str:
            told = [message[LINE] for message in await _events(client, server.handle["task"]) if LINE in message]
            return "".join(line + "\n" for line in told[-lines:])

        return self._asked(ask)

    def _asked(self, act: Callable[[Client], Awaitable[Result]]) -> Result:
        """What the scheduler answers. Raises BadInput where it does not."""
        where = scheduler_of(self._machine)
        try:
            return asyncio.run(asyncio.wait_for(_with_client(where, act), DASK_SECONDS))
        except (TimeoutError, OSError) as error:
            raise no_answer(where, error) from error


async def _with_client(where: dict[str, str], act: Callable[[Client], Awaitable[Result]]) -> Result:
    async with Client(**where, asynchronous=True, timeout=CONNECT_SECONDS, set_as_default=False) as client:
        return await act(client)


def cancelling(machine: Machine, servers: Sequence[StartedServer]) -> str:
    """The command by which a person ends those that wait for a worker, once the scheduler answers."""
    where = ", ".join(f"{key}={value!r}" for key, value in scheduler_of(machine).items())
    tasks = [server.handle["task"] for server in servers]
    lines = (
        "from distributed import Client, Future",
        f"client = Client({where})",
        f"client.cancel([Future(task, client) for task in {tasks}], force=True)",
    )
    return shlex.join(["python", "-c", "; ".join(lines)])


def scheduler_of(machine: Machine) -> dict[str, str]:
    """How Client is told of the scheduler. Raises BadInput where the file does not say."""
    if machine.dask.scheduler:
        return {"address": machine.dask.scheduler}
    if not machine.dask.scheduler_file:
        raise BadInput('the launcher dask needs dask.scheduler = "tcp://HOST:8786", or dask.scheduler-file')
    path = home_path(machine.dask.scheduler_file)
    if not path.is_file():
        raise BadInput(f"{path}: no such file; dask.scheduler-file is what `dask scheduler --scheduler-file` writes")
    return {"scheduler_file": str(path)}


def no_answer(where: dict[str, str], error: Exception) -> BadInput:
    return BadInput(
        f"Dask's scheduler at {next(iter(where.values()))} does not answer: "
        f"{error or f'nothing for {DASK_SECONDS:g} s'}; is it there, and dask.scheduler right?"
    )


async def _said(client: Client, task: str, state: str | None, workers: set[str]) -> Said:
    """How a task is that is in this state for the scheduler, which has these workers."""
    match state:
        case None:
            return Said(ServerState.ENDED, "Dask's scheduler does not know it any more")
        case "erred":
            return Said(ServerState.ENDED, _failure(await (await client.get_dataset(task)).exception()))
        case "no-worker":
            return Said(ServerState.QUEUED, "no worker of Dask's has the resources or the name that it asks for")
    events = await _events(client, task)
    if state in OVER:
        last = [message[LINE] for message in events if LINE in message][-1:]
        return Said(ServerState.ENDED, last[0] if last else "without a word")
    begun = [message[BEGUN] for message in events if BEGUN in message][-1:]
    if state == "processing" and begun and begun[0] in workers:
        return Said(ServerState.RUNNING, f"on {begun[0]}")
    return Said(ServerState.QUEUED, "no worker of Dask's has a free thread for it yet")


def _failure(error: BaseException | None) -> str:
    if isinstance(error, KilledWorker):
        return f"each worker that ran it was lost, at last {error.last_worker.address}"
    return f"{type(error).__name__}: {error}"


async def _events(client: Client, topic: str) -> list[dict[str, Any]]:
    return [message for _, message in await client.get_events(topic)]


async def _over(futures: Sequence[Future[None]]) -> None:
    """Until all are done, but not longer than a frozen worker is worth."""
    try:
        await asyncio.wait_for(asyncio.gather(*(future.exception() for future in futures)), GRACE_SECONDS)
    except TimeoutError:
        return


def host_name(machine: Machine) -> str:
    """The host that the file names, else the scheduler's, which is on the workers' network."""
    if machine.host is not None:
        return machine.host
    where = scheduler_of(machine)
    address = where.get("address") or _address_in(Path(where["scheduler_file"]))
    host = urlsplit(address if "://" in address else f"tcp://{address}").hostname
    if not host:
        raise BadInput(f"dask.scheduler: {address!r} names no host; give it as tcp://HOST:8786")
    return host


def _address_in(path: Path) -> str:
    """Of the scheduler that wrote this file."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=_SchedulerFile).address
    except (OSError, msgspec.DecodeError) as error:
        raise BadInput(f"{path}: this is no file of a Dask scheduler: {error}") from error


class _SchedulerFile(msgspec.Struct):
    address: str
