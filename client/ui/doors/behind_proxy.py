"""Tells the application where a proxy shows it, so that all addresses that it makes are those that the browser has."""

from __future__ import annotations

from starlette.types import ASGIApp, Receive, Scope, Send

from volsplat.client.ui.doors.public_address import PublicAddress

_ENCRYPTED = {"http": "https", "ws": "wss"}
_NOT_BELIEVED = b"x-forwarded-prefix"  # NiceGUI would take it: but where the page is, the person has said


class BehindProxy:
    """An ASGI application around another one. Inside, a path has its prefix and `root_path` names it."""

    def __init__(self, application: ASGIApp, behind: PublicAddress | None) -> None:
        self._application = application
        self._behind = behind

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = [(name, value) for name, value in scope["headers"] if name != _NOT_BELIEVED]
            scope = {**scope, "headers": headers}
            if self._behind is not None:
                scope |= self._seen(self._behind, scope)
        await self._application(scope, receive, send)

    def _seen(self, behind: PublicAddress, scope: Scope) -> Scope:
        path = behind.with_prefix(scope["path"])
        seen: Scope = {"root_path": behind.prefix, "path": path, "raw_path": path.encode()}
        if behind.encrypted and (b"host", behind.host.encode()) in scope["headers"]:
            seen["scheme"] = _ENCRYPTED.get(scope["scheme"], scope["scheme"])
        return seen
