"""Nothing without being admitted: no page, no script, no socket, no upload, no image."""

from __future__ import annotations

from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from volsplat.client.ui.doors.admission import Admission, Admitted, Asked, Refused, Welcomed
from volsplat.client.ui.doors.leading_page import asking_page, leading_page

_TOO_LARGE = "volsplat: this is more than the page takes\n"


class Gate:
    """An ASGI application before another one."""

    def __init__(self, application: ASGIApp, admission: Admission, largest_body: int) -> None:
        """A request's body may have `largest_body` bytes, and is held as a whole."""
        self._application = application
        self._admission = admission
        self._largest_body = largest_body

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return
        verdict = self._admission.judge(_asked(scope))
        if scope["type"] == "websocket":
            if isinstance(verdict, Admitted):
                await self._application(scope, receive, send)
            else:
                await WebSocketClose(code=1008, reason="refused")(scope, receive, send)
        elif isinstance(verdict, Admitted):
            await self._with_body(scope, receive, send)
        else:
            answer = _refusal(verdict) if isinstance(verdict, Refused) else _welcome(verdict)
            await answer(scope, receive, send)

    async def _with_body(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["method"] != "POST":
            await self._application(scope, receive, send)
            return
        body = await _body(receive, self._largest_body)
        if body is None:
            await PlainTextResponse(_TOO_LARGE, 413, {"Connection": "close"})(scope, receive, send)
            return
        whole: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def receiving() -> Message:
            return whole.pop() if whole else await receive()

        await self._application(scope, receiving, send)


def _asked(scope: Scope) -> Asked:
    return Asked(
        method=scope.get("method", "GET"),
        path=scope["path"],
        query=scope["query_string"].decode("latin-1"),
        headers=[(name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"]],
        peer=tuple(scope["client"] or ("", 0)),  # none if it has gone already
        here=tuple(scope["server"]),
        is_socket=scope["type"] == "websocket",
    )


def _refusal(verdict: Refused) -> Response:
    line = f"volsplat: {verdict.reason}"
    if verdict.instead:
        return HTMLResponse(asking_page(line, verdict.instead), verdict.status)
    return PlainTextResponse(f"{line}\n", verdict.status)


def _welcome(verdict: Welcomed) -> Response:
    headers = {"Set-Cookie": verdict.cookie}
    if verdict.steps_aside:
        return HTMLResponse(leading_page(verdict.location), headers=headers)
    return RedirectResponse(verdict.location, 303, headers)


async def _body(receive: Receive, largest: int) -> bytes | None:
    """A request's whole body; None if it is larger, or its sender has gone."""
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        body += message.get("body", b"")
        if len(body) > largest:
            return None
        if not message.get("more_body", False):
            return bytes(body)
