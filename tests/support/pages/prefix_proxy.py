"""A proxy that shows a server under a prefix of its own, as JupyterHub does, and refuses all that is not below it."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from support.patience import PATIENCE

_REQUEST = re.compile(rb"([A-Z]+) (\S+) (HTTP/1\.[01]\r\n)")
_CONNECTION = re.compile(rb"\r\nconnection: *keep-alive", re.IGNORECASE)
_NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


@dataclass
class PrefixProxy:
    """`cuts` says whether the server behind it gets paths without the prefix."""

    prefix: str
    cuts: bool
    port: int = 0
    target: int = 0  # the server's port, set before anything is asked
    outside: list[str] = field(default_factory=list)  # paths that were asked for and are not below the prefix

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}{self.prefix}/"

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One request for each connection."""
        try:
            with suppress(OSError, asyncio.IncompleteReadError):
                head = await reader.readuntil(b"\r\n\r\n")
                asked = _REQUEST.match(head)
                assert asked is not None, head
                path = asked[2].decode()
                if path.startswith(self.prefix + "/"):
                    passed = path.removeprefix(self.prefix) if self.cuts else path
                    rest = _CONNECTION.sub(b"\r\nConnection: close", head[asked.end() - 2 :])[2:]
                    await self._pass(asked[1] + b" " + passed.encode() + b" " + asked[3] + rest, reader, writer)
                else:
                    self.outside.append(path)
                    writer.write(_NOT_FOUND)
        finally:
            writer.close()

    async def _pass(self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        answers, server = await asyncio.open_connection("127.0.0.1", self.target)
        server.write(head)
        sending = asyncio.create_task(_relay(reader, server))
        try:
            await _relay(answers, writer)
        finally:
            sending.cancel()
            server.close()


@contextmanager
def prefix_proxy(prefix: str, *, cuts: bool) -> Iterator[PrefixProxy]:
    """Serve on a free port of loopback, by a thread: Playwright has a loop of its own in the test's."""
    proxy = PrefixProxy(prefix, cuts)
    ready: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()
    thread = threading.Thread(target=lambda: asyncio.run(_serve(proxy, ready)), name="prefix proxy", daemon=True)
    thread.start()
    loop, end = ready.result(PATIENCE)
    try:
        yield proxy
    finally:
        loop.call_soon_threadsafe(end.set)
        thread.join(PATIENCE)


async def _serve(proxy: PrefixProxy, ready: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]]) -> None:
    listening = await asyncio.start_server(proxy.serve, "127.0.0.1", 0)
    proxy.port = listening.sockets[0].getsockname()[1]
    end = asyncio.Event()
    ready.set_result((asyncio.get_running_loop(), end))
    await end.wait()
    listening.close()
    while left := asyncio.all_tasks() - {asyncio.current_task()}:
        for task in left:
            task.cancel()
        await asyncio.wait(left)


async def _relay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()
