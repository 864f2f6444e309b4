"""The volume that the page shows, if any; another one's viewing takes its place, for all tabs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from volsplat.client.session.session import Session
from volsplat.client.ui.opening.no_volume import NoVolume
from volsplat.client.ui.viewing.loss_watch import watch_for_losses
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Unsubscribe, Viewing


class ShownVolume:
    """`viewing` and `restart` are of the volume that is shown now; without a restart one that has ended stays so.

    There may be `none` of a volume at first: then `viewing` is None until one is taken. The session of one that is
    `lent` is the caller's, who goes on with it.
    """

    def __init__(
        self,
        viewing: Viewing | None = None,
        restart: Restart | None = None,
        none: NoVolume | None = None,
        lent: bool = False,
    ) -> None:
        self.viewing = viewing
        self.restart = restart
        self._none = none
        self._lent = lent
        self._on_first: list[Callable[[], None]] = []
        self._closing = threading.Lock()  # guards the viewing and what follows
        self._closed = False
        self._expected: Session | None = None  # of a volume that is being opened
        self._watch: asyncio.Task[None] | None = None

    @property
    def session(self) -> Session:
        """Of the servers that are there now."""
        if self.viewing is not None:
            return self.viewing.session
        assert self._none is not None, "there is a volume, or none"
        return self._none.session

    @asynccontextmanager
    async def drawn(self) -> AsyncIterator[None]:
        """What is shown is drawn within, and its losses are watched for."""
        if self.viewing is not None:
            self._begin(self.viewing)
        try:
            yield
        finally:
            if self._watch is not None:
                self._watch.cancel()
            if self.viewing is not None:
                await asyncio.to_thread(self.viewing.loop.close)

    def on_first(self, subscriber: Callable[[], None]) -> Unsubscribe:
        """Have `subscriber` called when a volume is shown where there was none."""
        self._on_first.append(subscriber)
        return lambda: self._on_first.remove(subscriber)

    def take(self, viewing: Viewing, restart: Restart | None) -> None:
        """Show another volume from now on; every tab goes over to it. In the event loop's thread.

        What was shown before ends meanwhile.
        """
        before = self.viewing
        with self._closing:
            self.viewing, self.restart = viewing, restart
            closed = self._closed
        if before is not None:
            viewing.number = before.number + 1
        if self._watch is not None:
            self._watch.cancel()
        if closed:
            viewing.close()
            return
        self._begin(viewing)
        for told in list(self._on_first if before is None else []):
            told()
        if before is not None:
            before.left()
        threading.Thread(target=self._end, args=(before,), name="end what was shown before").start()

    def leave(self) -> None:
        """Let the servers go, for another session at the same address."""
        self.session.close(another=True)

    def come_back(self) -> None:
        """Have what was left shown again."""
        if self.viewing is None and self._none is not None:
            self._none.begin_again()
        elif self.restart is not None:
            self.restart.start()

    def expect(self, session: Session | None) -> None:
        """Another volume is being opened by this session, or none any more. If all has ended, that ends at once."""
        with self._closing:
            self._expected = session
            closed = self._closed
        if closed:
            self.give_up()

    def give_up(self, another: bool = False) -> None:
        """End what is being opened; with `another` its servers look for one more session."""
        with self._closing:
            session = self._expected
        if session is not None:
            session.close(another)

    def close(self) -> None:
        """End the session unless it is lent, whichever it is by now, and what is being opened. Safe to call twice."""
        with self._closing:
            self._closed = True
            viewing = self.viewing
        self.give_up()
        if viewing is not None and not self._lent:
            viewing.close()
        if self._none is not None:
            self._none.close()

    def _begin(self, viewing: Viewing) -> None:
        loop = asyncio.get_running_loop()
        viewing.pictures.attach(loop)
        viewing.troubles.attach(loop)
        viewing.loop.start()
        self._watch = loop.create_task(watch_for_losses(viewing))

    def _end(self, before: Viewing | None) -> None:
        if before is not None:
            before.loop.close()
            before.close()
        elif self._none is not None:
            self._none.close()
