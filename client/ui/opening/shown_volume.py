"""The volume that the page shows; another one's viewing takes its place, for all tabs."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from volsplat.client.session.session import Session
from volsplat.client.ui.viewing.loss_watch import watch_for_losses
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Viewing


class ShownVolume:
    """`viewing` and `restart` are of the volume that is shown now; without a restart one that has ended stays so."""

    def __init__(self, viewing: Viewing, restart: Restart | None = None) -> None:
        self.viewing = viewing
        self.restart = restart
        self._closing = threading.Lock()  # guards the viewing and what follows
        self._closed = False
        self._expected: Session | None = None  # of a volume that is being opened
        self._watch: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def drawn(self) -> AsyncIterator[None]:
        """What is shown is drawn within, and its losses are watched for."""
        self._begin()
        try:
            yield
        finally:
            if self._watch is not None:
                self._watch.cancel()
            await asyncio.to_thread(self.viewing.loop.close)

    def take(self, viewing: Viewing, restart: Restart | None) -> None:
        """Show another volume from now on; every tab goes over to it. In the event loop's thread.

        What was shown before ends meanwhile.
        """
        before = self.viewing
        with self._closing:
            self.viewing, self.restart = viewing, restart
            closed = self._closed
        viewing.number = before.number + 1
        if self._watch is not None:
            self._watch.cancel()
        if closed:
            viewing.close()
            return
        self._begin()
        before.left()
        threading.Thread(target=_end, args=(before,), name="end the volume shown before").start()

    def expect(self, session: Session | None) -> None:
        """Another volume is being opened by this session, or none any more. If all has ended, that ends at once."""
        with self._closing:
            self._expected = session
            closed = self._closed
        if closed:
            self.give_up()

    def give_up(self) -> None:
        """End what is being opened."""
        with self._closing:
            session = self._expected
        if session is not None:
            session.close()

    def close(self) -> None:
        """End the session, whichever it is by now, and what is being opened. Safe to call twice."""
        with self._closing:
            self._closed = True
            viewing = self.viewing
        self.give_up()
        viewing.close()

    def _begin(self) -> None:
        loop = asyncio.get_running_loop()
        self.viewing.pictures.attach(loop)
        self.viewing.troubles.attach(loop)
        self.viewing.loop.start()
        self._watch = loop.create_task(watch_for_losses(self.viewing))


def _end(viewing: Viewing) -> None:
    viewing.loop.close()
    viewing.close()
