"""The progress of a preparation on the terminal: a bar for each stage, with its rate and the time left."""

import signal
from types import FrameType, TracebackType

from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from volsplat.program.plain_console import PlainConsole, task_words


class ProgressBar:
    """See progress.Progress. On what is no terminal, only notes are shown.

    Ctrl-C is raised between two blocks, where nothing is half done; the second one at once.
    """

    def __init__(self, console: PlainConsole) -> None:
        self._console = console
        self._task: TaskID | None = None
        self._stopping = False
        self._bar = Progress(
            task_words(),
            BarColumn(),
            TaskProgressColumn(),
            TransferSpeedColumn(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=console,
        )

    def __enter__(self) -> "ProgressBar":
        signal.signal(signal.SIGINT, self._stop)
        if self._console.is_terminal:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        if self._console.is_terminal:
            self._bar.stop()

    def note(self, text: str) -> None:
        self._console.say(text)

    def begin(self, stage: str, total: int) -> None:
        self._task = self._bar.add_task(stage, total=total)

    def advance(self, done: int) -> None:
        if self._task is not None:
            self._bar.advance(self._task, done)
        self.check_wanted()

    def check_wanted(self) -> None:
        if self._stopping:
            self.note("stopped; the same command goes on from here")
            raise KeyboardInterrupt

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self._stopping = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
