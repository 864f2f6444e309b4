"""How far a benchmark is, on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from volsplat.program.plain_console import PlainConsole, task_words
from volsplat.program.progress_lines import ProgressLines


@contextmanager
def shown_progress(title: str, total: int) -> Iterator[Callable[[], None]]:
    """Gives what to call after each of `total` parts of the work."""
    console = PlainConsole(stderr=True)
    if not console.is_terminal:
        yield ProgressLines(console, total, title).advance
        return
    columns = (task_words(), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task(title, total=total)
        yield lambda: progress.advance(task)
