"""The process that opened a volume: a process forked from it has neither its threads nor connections of its own."""

import os

from volsplat.protocol.text.errors import BadInput


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
