"""The page while the volume is not there yet: what is being done, and in its place the real page once that is served.

It answers on the socket that the real page takes over, and needs nothing that takes time to import.
"""

from __future__ import annotations

import logging
import secrets
import socket
import threading
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from string import Template
from typing import Any
from urllib.parse import urlsplit

from volsplat.client.ui.doors.admission import Admitted, Asked, Refused
from volsplat.client.ui.doors.leading_page import leading_page
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.page_policy import HEADERS, NOTHING, page_policy
from volsplat.client.ui.doors.static_files import STATIC

log = logging.getLogger(__name__)

WAITING_PATH = "/waiting"  # where the page asks what is being done

_PAGE = STATIC / "waiting.html"
_ASKING_SECONDS = 10.0  # that a browser may take to ask: anybody may call, and each call has a thread
_POLL_SECONDS = 0.05  # until it notices that it shall end
_TEXT, _HTML = "text/plain; charset=utf-8", "text/html; charset=utf-8"


class WaitingPage:
    """Serves at the address from `start` to `close`, and leaves its socket open."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self.line = "starting"  # what is being done; set from any thread
        self._admission = address.admission
        self._name = escape(name)
        self._page = Template(_PAGE.read_text("utf-8"))
        self._server = _Server(address.bound, self)
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(_POLL_SECONDS,), name="waiting page", daemon=True
        )

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Answer no more; twice does no harm."""
        self._server.shutdown()
        self._thread.join()

    def answer(self, asked: Asked) -> tuple[int, dict[str, str], str]:
        """Status, headers and body for what a browser asks for."""
        verdict = self._admission.judge(asked)
        if isinstance(verdict, Refused):
            return verdict.status, {"Content-Type": _TEXT}, f"volsplat: {verdict.reason}\n"
        if not isinstance(verdict, Admitted):
            return HTTPStatus.OK, {"Content-Type": _HTML, "Set-Cookie": verdict.cookie}, leading_page(verdict.location)
        behind = self._admission.behind
        path = asked.path if behind is None else behind.without_prefix(asked.path)
        if path == WAITING_PATH:
            return HTTPStatus.OK, {"Content-Type": _TEXT}, self.line
        if path != "/":
            return HTTPStatus.NOT_FOUND, {"Content-Type": _TEXT}, "volsplat: the page is not there yet\n"
        nonce = secrets.token_urlsafe(18)
        policy = {"Content-Security-Policy": page_policy(nonce, verdict.host)}
        return HTTPStatus.OK, {"Content-Type": _HTML} | policy, self._page.substitute(name=self._name, nonce=nonce)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, bound: socket.socket, page: WaitingPage) -> None:
        self.page = page
        super().__init__(bound.getsockname(), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = bound
        self.server_activate()

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.debug("a browser went away", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _ASKING_SECONDS

    def do_GET(self) -> None:
        url = urlsplit(self.path)
        status, headers, text = self.server.page.answer(
            Asked(
                method=self.command,
                path=url.path,
                query=url.query,
                headers=[(name.lower(), value) for name, value in self.headers.items()],
                peer=self.client_address[:2],
                here=self.request.getsockname()[:2],
            )
        )
        body = text.encode("utf-8", "replace")
        self.send_response(status)
        standing = HEADERS | {"Content-Security-Policy": NOTHING, "Cache-Control": "no-store"}
        for name, value in (standing | headers | {"Content-Length": str(len(body))}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        """Nothing: the terminal is the person's."""
