"""Notices servers that are lost while nobody draws, tells of them in words, and has what is left drawn."""

from __future__ import annotations

import asyncio

from volsplat.client.coordinator.server_states import losses
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.trouble import Trouble, trouble_of
from volsplat.client.ui.viewing.viewing import Viewing

SECONDS_BETWEEN_LOOKS = 0.25


async def watch_for_losses(viewing: Viewing) -> None:
    """Until cancelled."""
    watch = _LossWatch(viewing)
    leave = viewing.on_picture(watch.see)
    try:
        while True:
            watch.look()
            await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
    finally:
        leave()


class _LossWatch:
    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._session = viewing.session
        self._known: set[int] = set()  # servers whose loss was told
        self._over = False  # whether the end of the session was told
        self._told: Trouble | None = None  # of losses since the last picture of the whole volume

    def look(self) -> None:
        """Tell of losses that are new, and have the picture drawn by the others; or that there are none."""
        if self._viewing.session is not self._session:  # which has servers of its own
            self._session, self._known, self._over, self._told = self._viewing.session, set(), False, None
        found = losses(self._session.servers)
        new = [words for server, words in found.items() if server not in self._known]
        failure = self._session.failure
        if failure is not None and not self._over:
            self._over = True
            self._viewing.troubles.tell(trouble_of(failure, self._viewing.cure))
        elif new:
            self._known |= found.keys()
            self._told = Trouble("; ".join(new), lasting=True)
            self._viewing.troubles.tell(self._told)
            self._viewing.loop.draw_again()

    def see(self, picture: Picture) -> None:
        """Once others have taken over, the loss is told for a last time."""
        if self._told is None or picture.outcome is None:
            return
        servers = picture.outcome.servers
        if not servers.healing and not servers.missing:
            self._viewing.troubles.tell(Trouble(f"{self._told.text}; the picture is whole again"))
            self._told = None
