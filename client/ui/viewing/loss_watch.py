"""Notices servers that are lost while nobody draws, tells of them in words, and has what is left drawn."""

from __future__ import annotations

import asyncio

from volsplat.client.coordinator.server_states import losses
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.trouble import Trouble, end_of_session
from volsplat.client.ui.viewing.viewing import Viewing

SECONDS_BETWEEN_LOOKS = 0.25


async def watch_for_losses(viewing: Viewing) -> None:
    """Until cancelled."""
    watch = _LossWatch(viewing)
    leave = viewing.pictures.subscribe(watch.see)
    try:
        while True:
            watch.look()
            await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
    finally:
        leave()


class _LossWatch:
    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._begin()

    def _begin(self) -> None:
        self._session = self._viewing.session
        self._known: set[int] = set()  # servers that were lost
        self._over = False  # whether the end of the session was told
        self._told: dict[int, str] = {}  # of servers that were lost since the last picture of the whole volume

    def look(self) -> None:
        """Tell of losses that are new, and have the picture drawn by the others; or that there are none."""
        if self._viewing.session is not self._session:  # which has servers of its own
            self._begin()
        failure = self._session.failure
        if failure is None:
            self._look_for_losses()
        elif not self._over:
            self._over = True
            self._viewing.troubles.tell(end_of_session(failure, self._viewing.cure))

    def _look_for_losses(self) -> None:
        """What is missing may be told before others are found that take over: then that is told as well."""
        found = losses(self._session.servers)
        new = found.keys() - self._known
        changed = {n: words for n, words in found.items() if n in new or words != self._told.get(n, words)}
        if changed:
            self._known |= new
            self._told |= changed
            self._viewing.troubles.tell(Trouble("; ".join(changed.values()), lasting=True))
        if new:
            self._viewing.loop.draw_again()

    def see(self, picture: Picture) -> None:
        """Once others have taken over, the loss is told for a last time."""
        if not self._told or picture.outcome is None:
            return
        servers = picture.outcome.servers
        if not servers.healing and not servers.missing:
            found = losses(self._session.servers)
            words = "; ".join(found.get(n, words) for n, words in self._told.items())
            self._viewing.troubles.tell_end(f"{words}; the picture is whole again")
            self._told = {}
