"""What a program asks of a lab's machines that share its work, whichever engine they run."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class TaskPool(Protocol):
    """Processes on many machines. Tasks and what they return are pickled, and a task may be done more than once.

    `meanwhile` is called again and again while nothing has come, and may raise to give up.
    """

    def on_each(self, task: Callable[[], None], meanwhile: Callable[[], None]) -> None:
        """Does it once in each process that is there. Raises BadInput, with the process's name, if one cannot."""

    def results(
        self, task: Callable[[Item], Result], items: Iterable[Item], meanwhile: Callable[[], None]
    ) -> Iterator[Result]:
        """Of each item, as they are finished. Closing the iterator calls off what has not."""


PoolOpener = Callable[[Path, Callable[[str], None]], AbstractContextManager[TaskPool]]
"""Called with a cluster file, and with what says a line to the person."""
