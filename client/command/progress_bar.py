"""A bar on the terminal, or lines in a log, for commands that make many images, or sheets of a volume."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

from volsplat.program.plain_console import PlainConsole, task_words
from volsplat.program.progress_lines import ProgressLines

START = "starting"


@contextmanager
def shown_progress(images: int, console: PlainConsole) -> Iterator[tuple[Callable[[str], None], Callable[[int], None]]]:
    """Gives what to call with words, and what to call with the number of images that are done."""
    if not console.is_terminal:
        lines = ProgressLines(console, images, START)
        yield lines.describe, lines.reach
        return
    columns = (task_words(), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(START, total=images)
        yield (
            lambda text: progress.update(task, description=text),
            lambda done: progress.update(task, completed=done),
        )
