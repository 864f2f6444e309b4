"""Starts a session again that has ended, for as long as the page is open."""

from __future__ import annotations

import threading
from collections.abc import Callable

from volsplat.client.session.session import Session
from volsplat.client.ui.viewing.trouble import Trouble, end_of_session
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.text.errors import VolsplatError

# To start it once more would lead here again.
_ANOTHER_VOLUME = Trouble(
    "its file was saved anew meanwhile, and the volume is another one: save the scene, then open the file anew (O)",
    lasting=True,
)

# A session like the first one; it is given what to do with the words for what takes time.
OpenSession = Callable[[Callable[[str], None]], Session]


class Restart:
    """Puts a session like the first in the place of one that has ended. Any tab may ask for it, at any time."""

    def __init__(self, viewing: Viewing, open_session: OpenSession) -> None:
        self._viewing = viewing
        self._open_session = open_session
        self._starting = False
        self._changing = threading.Lock()  # guards that, and what is told because of it

    @property
    def starting(self) -> bool:
        return self._starting

    @property
    def wanted(self) -> bool:
        """Whether the session has ended, and nobody has started it again."""
        return self._viewing.session.failure is not None and not self.starting

    def start(self) -> None:
        """Start it if that is wanted; returns when the scene is drawn again, or was told why it cannot be."""
        with self._changing:
            if not self.wanted:
                return
            self._starting = True
        try:
            self._say("it is being started again")
            failed = self._started()
        finally:
            with self._changing:
                self._starting = False
        if failed is None:
            self._viewing.troubles.tell_end("it was started again")
        else:
            self._viewing.troubles.tell(failed)

    def _started(self) -> Trouble | None:
        """What is to be told of it if that failed."""
        viewing = self._viewing
        viewing.session.close()  # its port may be wanted again
        try:
            viewing.take(self._open_session(self._say))
            if viewing.session.volume.description != viewing.volume.description:
                viewing.session.close()
                return _ANOTHER_VOLUME
        except VolsplatError as error:
            return end_of_session(error, viewing.cure)
        viewing.loop.draw_with(viewing.session)
        return None

    def _say(self, words: str) -> None:
        """While it is being started: the session goes on to tell what takes time, as each frame does."""
        with self._changing:
            if self._starting:
                self._viewing.troubles.tell(Trouble(words, lasting=True))
