"""The WebSocket of one tab's viewport."""

from __future__ import annotations

import asyncio
import contextlib
import logging

from starlette.websockets import WebSocket, WebSocketDisconnect

from volsplat.client.ui.viewing import Viewing
from volsplat.client.ui.viewport_talk import ViewportTalk

log = logging.getLogger(__name__)


async def serve_viewport(viewing: Viewing, socket: WebSocket, tab: str) -> None:
    """Carry what is said, until the page goes away."""
    await socket.accept()
    outgoing: asyncio.Queue[str | bytes] = asyncio.Queue()  # bounded by what may be under way
    talk = ViewportTalk(viewing, tab, outgoing.put_nowait)
    sending = asyncio.create_task(_send(socket, outgoing))
    talk.begin()
    try:
        while True:
            talk.heard(await socket.receive_text())
    except WebSocketDisconnect:
        log.info("tab %s has gone", tab)
    finally:
        talk.end()
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending


async def _send(socket: WebSocket, outgoing: asyncio.Queue[str | bytes]) -> None:
    try:
        while True:
            message = await outgoing.get()
            await (socket.send_text(message) if isinstance(message, str) else socket.send_bytes(message))
    except (WebSocketDisconnect, RuntimeError) as error:  # it was closed amid this; whoever receives hears of it, too
        log.info("the page went away: %s", error)
