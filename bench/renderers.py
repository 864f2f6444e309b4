"""The renderers that are measured against each other: the single process, and servers in several numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from volsplat.client.session.renderer import Renderer
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.deploy.local import LocalServers
from volsplat.deploy.server_command import Program
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.volume_name import absolute_name
from volsplat.protocol.text.errors import PeerLost
from volsplat.protocol.wire.tokens import find_token, new_token

SINGLE = "1 thread"  # of a single process


@dataclass(frozen=True)
class Row:
    """A renderer by the number of its map/shade servers; 0 is the single process with one thread."""

    workers: int
    renderer: Renderer

    @property
    def name(self) -> str:
        return SINGLE if self.workers == 0 else servers_words(self.workers)

    @property
    def processes(self) -> int:
        """That draw: the map/shade servers and the splat server."""
        return self.workers + 1


def servers_words(workers: int) -> str:
    """Map/shade servers; the splat server beside them goes without saying."""
    return f"{workers} server{'s' if workers > 1 else ''}"


@contextmanager
def opened_rows(
    path: str,
    workers: Sequence[int],
    say: Callable[[str], None],
    memory: int | None,
    like_machines: bool = False,
) -> Iterator[list[Row]]:
    """The single process and a session for each number of servers, all with the volume in memory.

    `memory` is how many bytes of a prepared volume each of them may hold. All map/shade servers of a session share out
    the cores; `like_machines` each has as many threads whatever their number, as if it were a machine.
    """
    with ExitStack() as stack:
        rows = [Row(0, stack.enter_context(SingleProcess(path, memory=memory, on_progress=say)))]
        for count in workers:
            if like_machines:
                servers = session_of_machines(path, count, threads_of_each(workers), say, memory)
            else:
                servers = local_session(path, count, say, memory)
            rows.append(Row(count, stack.enter_context(servers)))
        yield rows


def threads_of_each(workers: Sequence[int]) -> int:
    """Of a map/shade server, so that the cores are enough for the greatest of these numbers of servers."""
    return max(1, usable_cores() // max(workers))


@contextmanager
def session_of_machines(
    path: str, workers: int, threads: int, say: Callable[[str], None], memory: int | None
) -> Iterator[Session]:
    """Map/shade servers of this machine with so many `threads` each, and a splat server that may use every core.

    Raises PeerLost if one of them ends.
    """
    token = find_token(os.environ, None) or new_token()
    ended: list[str] = []

    def end(line: str, name: str, again: bool) -> None:
        if not again:  # or it is not waited for
            ended.append(line)
            session.close()

    servers = LocalServers(end)
    with ExitStack() as stack:
        stack.callback(servers.stop)
        session = stack.enter_context(
            Session(absolute_name(path), workers=workers, spawn=False, token=token, memory=memory, on_progress=say)
        )
        stack.callback(servers.let_end)
        servers.start(Program.SPLAT_SERVER, str(session.address), token, usable_cores())
        for _ in range(workers):
            servers.start(Program.MAPSHADE_SERVER, str(session.address), token, threads)
        try:
            assert session.volume, "wait until its servers have read the volume"
            yield session
        except PeerLost as error:
            raise (PeerLost(ended[0]) if ended else error) from None


@contextmanager
def local_session(
    path: str, workers: int, say: Callable[[str], None], memory: int | None = None, splat_servers: int = 1
) -> Iterator[Session]:
    """Servers of this machine that have read the volume, with the environment's token if it has one."""
    token = find_token(os.environ, None)
    with Session(
        path, workers=workers, splat_servers=splat_servers, token=token, memory=memory, on_progress=say
    ) as session:
        assert session.volume, "wait until its servers have read the volume"
        yield session
