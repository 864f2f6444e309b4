"""A relay that makes a connection as slow as a distant one: so many bits a second, so many seconds a round trip."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager

CHUNK = 4096  # bytes that travel together
QUEUED_SECONDS = 0.1  # of data that may wait in the relay, as in a router, before the sender must


class _Direction:
    """One way of one connection."""

    def __init__(self, bits_per_second: float, delay: float) -> None:
        self._seconds_per_byte = 8.0 / bits_per_second
        self._delay = delay
        self._free_at = 0.0  # when the line has sent all that it was given
        self._on_the_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

    async def take(self, reader: asyncio.StreamReader) -> None:
        clock = asyncio.get_running_loop()
        while True:
            data = await reader.read(CHUNK)
            now = clock.time()
            self._free_at = max(self._free_at, now) + len(data) * self._seconds_per_byte
            self._on_the_way.put_nowait((self._free_at + self._delay, data))
            if not data:
                return
            await asyncio.sleep(max(0.0, self._free_at - now - QUEUED_SECONDS))

    async def give(self, writer: asyncio.StreamWriter) -> None:
        clock = asyncio.get_running_loop()
        while True:
            at, data = await self._on_the_way.get()
            await asyncio.sleep(max(0.0, at - clock.time()))
            if not data:
                with contextlib.suppress(OSError):
                    writer.write_eof()
                return
            writer.write(data)
            await writer.drain()


@contextmanager
def slow_link(port: int, *, bits_per_second: float, round_trip: float, at: int = 0) -> Iterator[int]:
    """A port of this machine, any free one or `at`, that leads to `port`, slowly.

    `round_trip` in seconds, half of it each way.
    """
    loop = asyncio.new_event_loop()

    async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there_reader, there_writer = await asyncio.open_connection("127.0.0.1", port)
        there = _Direction(bits_per_second, round_trip / 2)
        back = _Direction(bits_per_second, round_trip / 2)
        # An end goes, and so does the other, or all ends: a stream's task that is cancelled would say so on stderr.
        with contextlib.closing(writer), contextlib.closing(there_writer):
            with contextlib.suppress(OSError, asyncio.CancelledError):
                await asyncio.gather(
                    there.take(reader), there.give(there_writer), back.take(there_reader), back.give(writer)
                )

    async def listen() -> asyncio.Server:
        return await asyncio.start_server(connected, "127.0.0.1", at)

    thread = threading.Thread(target=loop.run_forever, name="slow link")
    thread.start()
    server = asyncio.run_coroutine_threadsafe(listen(), loop).result()
    try:
        yield int(server.sockets[0].getsockname()[1])
    finally:
        asyncio.run_coroutine_threadsafe(_ended(server), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _ended(server: asyncio.Server) -> None:
    server.close()
    connections = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    for task in connections:
        task.cancel()
    await asyncio.gather(*connections, return_exceptions=True)
