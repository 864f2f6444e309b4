"""The WebSocket of one tab's viewport."""

from __future__ import annotations

import asyncio
import contextlib
import logging

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.ui.viewport.viewport_talk import ViewportTalk

log = logging.getLogger(__name__)

_NO_TEXT = 1003  # the close code for what cannot be accepted
OTHER_VOLUME = 4001  # the close code that has the page loaded anew, since another volume is shown


async def serve_viewport(viewing: Viewing, socket: WebSocket, tab: str) -> None:
    """Carry what is said, until the page goes away."""
    await socket.accept()
    outgoing: asyncio.Queue[str | bytes | None] = asyncio.Queue()  # bounded by what may be under way
    talk = ViewportTalk(viewing, tab, outgoing.put_nowait)
    sending = asyncio.create_task(_send(socket, outgoing))
    unsubscribe = viewing.on_left(lambda: outgoing.put_nowait(None))
    try:
        talk.begin()
        while (text := await _received(socket)) is not None:
            talk.heard(text)
        log.info("tab %s has gone", tab)
    finally:
        unsubscribe()
        talk.end()
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await sending


async def _received(socket: WebSocket) -> str | None:
    """What the page says next, None once it is gone. Anything but text is taken for a page of something else."""
    if socket.application_state is WebSocketState.DISCONNECTED:  # sending has noticed it
        return None
    message = await socket.receive()
    if message["type"] == "websocket.receive" and message.get("text") is None:
        await socket.close(code=_NO_TEXT)
        return None
    text: str | None = message.get("text")
    return text


async def turn_away(socket: WebSocket) -> None:
    """Have a page of another volume loaded anew."""
    await socket.accept()
    await socket.close(OTHER_VOLUME)


async def _send(socket: WebSocket, outgoing: asyncio.Queue[str | bytes | None]) -> None:
    """None: there will be no more, since another volume is shown."""
    try:
        while (message := await outgoing.get()) is not None:
            await (socket.send_text(message) if isinstance(message, str) else socket.send_bytes(message))
        await socket.close(OTHER_VOLUME)
    except (WebSocketDisconnect, RuntimeError) as error:  # it was closed amid this; whoever receives hears of it, too
        log.info("the page went away: %s", error)
