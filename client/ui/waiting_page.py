"""The page while the volume is not there yet: what is being done, and in its place the real page once that is served.

It answers on the socket that the real page takes over, and needs nothing that takes time to import.
"""

from __future__ import annotations

import hmac
import socket
import threading
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from string import Template
from urllib.parse import parse_qs, urlsplit

from volsplat.client.ui.page_address import TOKEN_PARAMETER, PageAddress

_PAGE = Path(__file__).parent / "static" / "waiting.html"
_POLL_SECONDS = 0.05  # until it notices that it shall end


class WaitingPage:
    """Serves at the address from `start` to `close`, and leaves its socket open."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self.line = "starting"  # what is being done; set from any thread
        self._token = address.token
        self._page = Template(_PAGE.read_text("utf-8")).substitute(name=escape(name)).encode()
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

    def answer(self, address: str) -> tuple[HTTPStatus, str, bytes]:
        """Status, type and body for what a browser asks for. Nothing without the token."""
        url = urlsplit(address)
        (given, *_) = parse_qs(url.query).get(TOKEN_PARAMETER, [""])
        if not hmac.compare_digest(given.encode(), self._token.encode()):
            return HTTPStatus.FORBIDDEN, "text/plain", b""
        if url.path == "/waiting":
            return HTTPStatus.OK, "text/plain; charset=utf-8", self.line.encode()
        return HTTPStatus.OK, "text/html; charset=utf-8", self._page


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, bound: socket.socket, page: WaitingPage) -> None:
        self.page = page
        super().__init__(bound.getsockname(), _Handler, bind_and_activate=False)
        self.socket.close()
        self.socket = bound
        self.server_activate()


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        status, kind, body = self.server.page.answer(self.path)
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("Referrer-Policy", "no-referrer"),
        ):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        """Nothing: the terminal is the person's."""
