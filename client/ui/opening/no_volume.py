"""Servers without a volume: they tell what can be opened, until a person chooses."""

from __future__ import annotations

import threading
from collections.abc import Callable

from volsplat.client.session.session import Session


class NoVolume:
    """Has a session of them; one that was closed for another may be begun anew, unless all has ended."""

    def __init__(self, open_session: Callable[[], Session]) -> None:
        self._open_session = open_session
        self._guard = threading.Lock()  # of what follows
        self._closed = False
        self.session = open_session()

    def begin_again(self) -> None:
        """Where what was chosen cannot be opened."""
        with self._guard:
            if not self._closed:
                self.session = self._open_session()

    def close(self) -> None:
        """End it, whichever it is by now. Safe to call twice."""
        with self._guard:
            self._closed = True
            session = self.session
        session.close()
