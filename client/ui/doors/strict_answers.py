"""ASGI applications around the page's, which give its answers the headers of its policy, and its scripts a nonce."""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable, Mapping

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from volsplat.client.ui.doors.page_policy import HEADERS, NOTHING, page_policy
from volsplat.client.ui.doors.public_address import PublicAddress

_SCRIPT = re.compile(rb"<script(?=[\s>])")


class StrictHeaders:
    """An ASGI application around another one, whose every answer gets the headers that it does not set itself."""

    def __init__(self, application: ASGIApp, kept: Mapping[str, str]) -> None:
        """What lies under a path of `kept` may be kept by the browser as that says, and nothing else."""
        self._application = application
        self._kept = kept

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(raw=message["headers"])
                for name, value in (HEADERS | {"Content-Security-Policy": NOTHING}).items():
                    headers.setdefault(name, value)
                kept = (how for path, how in self._kept.items() if scope["path"].startswith(path))
                headers.setdefault("Cache-Control", next(kept, "no-store"))
            await send(message)

        await self._application(scope, receive, sending if scope["type"] == "http" else send)


class ScriptNonces:
    """An ASGI application around one whose pages have scripts in them: gives these a nonce, and the page its policy."""

    def __init__(self, application: ASGIApp, finish: Callable[[bytes], bytes] = bytes) -> None:
        """`finish` makes of each page what is sent."""
        self._application = application
        self._finish = finish

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        start: Message | None = None
        body = bytearray()

        async def sending(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start" and _is_page(message):
                start = message
            elif start is None:
                await send(message)
            else:
                body.extend(message.get("body", b""))
                if not message.get("more_body", False):
                    await _send_page(scope, start, self._finish(bytes(body)), send)

        await self._application(scope, receive, sending)


async def _send_page(scope: Scope, start: Message, body: bytes, send: Send) -> None:
    nonce = secrets.token_urlsafe(18)
    body = _SCRIPT.sub(f'<script nonce="{nonce}"'.encode(), body)
    headers = MutableHeaders(raw=start["headers"])
    if "content-length" in headers:
        headers["content-length"] = str(len(body))
    host = next((value.decode("latin-1") for name, value in scope["headers"] if name == b"host"), "")
    headers["Content-Security-Policy"] = page_policy(nonce, PublicAddress(scope["scheme"], host))
    await send(start)
    await send({"type": "http.response.body", "body": body})


def _is_page(start: Message) -> bool:
    return MutableHeaders(raw=start["headers"]).get("content-type", "").startswith("text/html")
