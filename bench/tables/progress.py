"""How far a benchmark is, on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count

from volsplat.client.command import progress_bar
from volsplat.client.command.side_console import SideConsole


@contextmanager
def shown_progress(title: str, total: int) -> Iterator[Callable[[], None]]:
    """Gives what to call after each of `total` parts of the work."""
    with progress_bar.shown_progress(total, SideConsole()) as (describe, reach):
        describe(title)
        parts = count(1)
        yield lambda: reach(next(parts))
