"""The console of every command: what is printed is data, and never a way of writing.

Names of files, words of a volume and texts of other programs may hold brackets, colons and control characters. Rich
would take the first for its markup, the second for emoji, and hand the third to the terminal.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import TextColumn
from rich.segment import Segment
from rich.status import Status
from rich.text import Text

from volsplat.protocol.text.printable import printable

_STROKES = str.maketrans("▁▂▃▄▅▆▇█─", ".,:;=+*#-")  # of charts, where the terminal has none


class PlainConsole(Console):
    """Prints to stdout or stderr. Markup, emoji and highlighting are off; nothing can steer the terminal."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, emoji=False, highlight=False)
        self._status: PlainStatus | None = None

    def say(self, line: str) -> None:
        """Print one line, whatever its length: only the terminal breaks it, so that a path can be copied."""
        self.print(Text(printable(line)), soft_wrap=True)

    def status(self, status: RenderableType, **options: Any) -> PlainStatus:
        """What is being done, while it is. Its `update` takes plain words, too."""
        self._status = PlainStatus(_plain(status), console=self, **options)
        return self._status

    def end_status(self) -> None:
        """Before its block ends: what follows goes on until a person ends it, and nothing needs to be waited for."""
        if self._status is not None:
            self._status.stop()

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """All that is printed passes here."""
        has_strokes = self.encoding.lower().startswith("utf")
        for segment in super().render(renderable, options):
            text = segment.text if has_strokes else segment.text.translate(_STROKES)
            if segment.control or (text is segment.text and text.isprintable()):
                yield segment
            else:
                yield Segment("\n".join(printable(line) for line in text.split("\n")), segment.style)


class PlainStatus(Status):
    """A status whose words are no markup."""

    def update(self, status: RenderableType | None = None, **options: Any) -> None:
        super().update(None if status is None else _plain(status), **options)


def task_words() -> TextColumn:
    """The column of a progress bar that says what is being done."""
    return TextColumn("{task.description}", markup=False)


def _plain(words: RenderableType) -> RenderableType:
    return Text(printable(words)) if isinstance(words, str) else words
