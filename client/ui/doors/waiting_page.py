"""The page while the volume is not there yet: its frame, with what is being done and then the first picture in it.

The real page takes its place once that is served, and goes on from the same picture. This one answers on the socket
that the real page takes over, and needs nothing that takes time to import.
"""

from __future__ import annotations

import logging
import secrets
import socket
import threading
from concurrent.futures import Future
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
from volsplat.client.ui.doors.static_files import STATIC, frame_styles

log = logging.getLogger(__name__)

WAITING_PATH = "/waiting"  # where the page asks what is being done
SEEN_PARAMETER = "seen"  # what it knows of that
EARLY_PATH = "/early"  # where a page asks for the picture that it shows until its viewport stands

_PAGE = STATIC / "waiting.html"
_ASKING_SECONDS = 10.0  # that a browser may take to ask: anybody may call, and each call has a thread
_ANSWER_SECONDS = 10.0  # that it may wait for another line or the picture, until it asks again
_POLL_SECONDS = 0.01  # until it notices that it shall end
_TEXT, _HTML = "text/plain; charset=utf-8", "text/html; charset=utf-8"


class WaitingPage:
    """Serves at the address from `start` to `close`, and leaves its socket open."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self._line = "starting"  # what is being done
        self._closed = False
        self._changed = threading.Condition()  # guards the two
        self._admission = address.admission
        self._name = escape(name)
        self._page = Template(_PAGE.read_text("utf-8"))
        self._picture: Future[bytes] = Future()
        self._server = _Server(address.bound, self)
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(_POLL_SECONDS,), name="waiting page", daemon=True
        )

    def start(self) -> None:
        self._thread.start()

    def say(self, line: str) -> None:
        """What is being done, from any thread."""
        with self._changed:
            self._line = line
            self._changed.notify_all()

    def show(self, picture: bytes) -> None:
        """Show a picture, as JPEG, from any thread; also to whoever asked for it before the end."""
        self._picture.set_result(picture)

    def close(self) -> None:
        """Take no more requests; twice does no harm."""
        self._server.shutdown()
        self._thread.join()
        with self._changed:  # whoever is waiting may ask the real page
            self._closed = True
            self._changed.notify_all()

    def answer(self, asked: Asked) -> tuple[int, dict[str, str], str | bytes]:
        """Status, headers and body for what a browser asks for."""
        verdict = self._admission.judge(asked)
        if isinstance(verdict, Refused):
            return verdict.status, {"Content-Type": _TEXT}, f"volsplat: {verdict.reason}\n"
        if not isinstance(verdict, Admitted):
            return HTTPStatus.OK, {"Content-Type": _HTML, "Set-Cookie": verdict.cookie}, leading_page(verdict.location)
        behind = self._admission.behind
        path = asked.path if behind is None else behind.without_prefix(asked.path)
        if path == WAITING_PATH:
            return HTTPStatus.OK, {"Content-Type": _TEXT}, self._line_after(dict(asked.parameters).get(SEEN_PARAMETER))
        if path == EARLY_PATH:
            return self._first_picture()
        if path != "/":
            return HTTPStatus.NOT_FOUND, {"Content-Type": _TEXT}, "volsplat: the page is not there yet\n"
        nonce = secrets.token_urlsafe(18)
        policy = {"Content-Security-Policy": page_policy(nonce, verdict.place)}
        page = self._page.substitute(name=self._name, nonce=nonce, styles=frame_styles())
        return HTTPStatus.OK, {"Content-Type": _HTML} | policy, page

    def _line_after(self, seen: str | None) -> str:
        """What is being done, once that is another line than the one seen, or after a while."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._line != seen, _ANSWER_SECONDS)
            return self._line

    def _first_picture(self) -> tuple[int, dict[str, str], bytes]:
        try:
            return HTTPStatus.OK, {"Content-Type": "image/jpeg"}, self._picture.result(_ANSWER_SECONDS)
        except TimeoutError:
            return HTTPStatus.NO_CONTENT, {}, b""


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
        status, headers, content = self.server.page.answer(
            Asked(
                method=self.command,
                path=url.path,
                query=url.query,
                headers=[(name.lower(), value) for name, value in self.headers.items()],
                peer=self.client_address[:2],
                here=self.request.getsockname()[:2],
            )
        )
        body = content if isinstance(content, bytes) else content.encode("utf-8", "replace")
        self.send_response(status)
        standing = HEADERS | {"Content-Security-Policy": NOTHING, "Cache-Control": "no-store"}
        for name, value in (standing | headers | {"Content-Length": str(len(body))}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        """Nothing: the terminal is the person's."""
