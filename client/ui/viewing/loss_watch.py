"""Notices servers that are lost while nobody draws, tells of them in words, and has what is left drawn."""

from __future__ import annotations

import asyncio

from volsplat.client.coordinator.server_states import losses
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.text.errors import PeerLost

SECONDS_BETWEEN_LOOKS = 0.25


async def watch_for_losses(viewing: Viewing) -> None:
    """Until cancelled."""
    known: set[int] = set()
    while True:
        told = losses(viewing.session.servers)
        if told.keys() - known:
            known = set(told)
            viewing.troubles.tell(PeerLost("; ".join(told.values())))
            viewing.loop.draw_again()
        await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
