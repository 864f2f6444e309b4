"""The process that opened a volume: a process forked from it has neither its threads nor connections of its own."""

import os
from collections.abc import Iterator
from typing import TypeVar

from volsplat.protocol.text.errors import BadInput

Drawn = TypeVar("Drawn")


class OwnProcess:
    """The one that made this."""

    def __init__(self) -> None:
        self._process = os.getpid()

    @property
    def is_here(self) -> bool:
        return self._process == os.getpid()

    def check(self) -> None:
        """Raises BadInput in a process that was forked from it, where nobody would ever answer."""
        if not self.is_here:
            raise BadInput("this volume was opened before this process was forked; open it anew in each process")

    def checked(self, images: Iterator[Drawn]) -> Iterator[Drawn]:
        """These, each waited for in no other process. Raises BadInput as `check` does."""
        self.check()
        for image in images:
            yield image
            self.check()
