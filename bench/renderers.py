"""The renderers that are measured against each other: the single process, and servers in several numbers."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from volsplat.client.session.renderer import Renderer
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.wire.tokens import find_token

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
    path: str, workers: Sequence[int], say: Callable[[str], None], memory: int | None = None
) -> Iterator[list[Row]]:
    """The single process and a session for each number of servers, all with the volume in memory.

    `memory` is how many bytes of a prepared volume each of them may hold.
    """
    with ExitStack() as stack:
        rows = [Row(0, stack.enter_context(SingleProcess(path, memory=memory, on_progress=say)))]
        for count in workers:
            session = stack.enter_context(local_session(path, count, say, memory))
            rows.append(Row(count, session))
        yield rows


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
