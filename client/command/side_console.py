"""What a command tells on stderr beside its work: if that gets nowhere, the work goes on and its files count."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from volsplat.program.plain_console import PlainConsole


class SideConsole(PlainConsole):
    """Prints to stderr, and no more once that is lost: an unread pipe, a full disk, a terminal that is gone."""

    def __init__(self) -> None:
        super().__init__(stderr=True)

    def _check_buffer(self) -> None:
        """All that is written passes here, of lines as of a status and its end."""
        try:
            super()._check_buffer()
        except OSError:
            self._fall_silent()

    def on_broken_pipe(self) -> None:
        """In place of an exit."""
        self._fall_silent()

    def _fall_silent(self) -> None:
        self.quiet = True
        with suppress(OSError, AttributeError):  # what stderr still holds would fail once more at the process's end
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stderr.fileno())
            os.close(nowhere)
