"""Notices servers that are lost while nobody draws, tells of them in words, and has what is left drawn."""

from __future__ import annotations

import asyncio

from volsplat.client.coordinator.server_states import incomplete
from volsplat.client.ui.viewing.viewing import Viewing

SECONDS_BETWEEN_LOOKS = 0.25


async def watch_for_losses(viewing: Viewing) -> None:
    """Until cancelled."""
    known: set[int] = set()
    while True:
        lost = [server for server in viewing.session.servers if server.lost and server.boxes]
        if any(server.id not in known for server in lost):
            known = {server.id for server in lost}
            viewing.troubles.tell(incomplete(lost))
            viewing.loop.draw_again()
        await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
