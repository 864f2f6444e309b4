"""Nothing without the token: no page, no script, no socket, no image.

The address that `volsplat view` prints carries it; the first answer turns it into a cookie, so that it stays out of
what the page links to.
"""

from __future__ import annotations

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from volsplat.client.ui.page_address import TOKEN_PARAMETER

_REFUSAL = "volsplat: this page needs the token of its address; use the whole address that `volsplat view` printed\n"


class Gate:
    """An ASGI application before another one."""

    def __init__(self, application: ASGIApp, token: str, port: int) -> None:
        self._application = application
        self._token = token
        # Cookies do not tell ports apart, and several sessions may run on one machine.
        self._cookie = f"volsplat-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan" or self._has_cookie(scope):
            await self._application(scope, receive, send)
        elif scope["type"] == "http" and self._in_address(scope):
            await self._welcome(scope)(scope, receive, send)
        elif scope["type"] == "http":
            await PlainTextResponse(_REFUSAL, 403)(scope, receive, send)
        else:
            await WebSocketClose(code=1008, reason="the token is missing")(scope, receive, send)

    def _has_cookie(self, scope: Scope) -> bool:
        for name, value in scope["headers"]:
            if name == b"cookie":
                try:
                    cookie = SimpleCookie(value.decode("latin-1")).get(self._cookie)
                except CookieError:
                    continue
                if cookie is not None and self._is_token(cookie.value):
                    return True
        return False

    def _in_address(self, scope: Scope) -> bool:
        return any(name == TOKEN_PARAMETER and self._is_token(value) for name, value in _parameters(scope))

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self._token.encode())

    def _welcome(self, scope: Scope) -> RedirectResponse:
        others = [(name, value) for name, value in _parameters(scope) if name != TOKEN_PARAMETER]
        response = RedirectResponse(scope["path"] + ("?" + urlencode(others) if others else ""), 303)
        response.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
        response.headers["Referrer-Policy"] = "no-referrer"
        return response


def _parameters(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope["query_string"].decode("latin-1"))
