"""A web server of a folder on this machine, which counts what it sends, byte ranges included."""

import mimetypes
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

from support.patience import PATIENCE


def _set() -> threading.Event:
    event = threading.Event()
    event.set()
    return event


@dataclass
class Served:
    """Where the folder is served, and what was sent of it: paths that were there, with the bytes of each answer."""

    url: str = ""
    sent: list[tuple[str, int]] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)  # paths, be they there or not
    status: int = HTTPStatus.OK  # another one is the answer to everything
    lets_go: threading.Event = field(default_factory=_set)  # while it is not set, all but JSON is held back
    waiting: list[str] = field(default_factory=list)  # paths that are held back

    @property
    def paths(self) -> set[str]:
        return {path for path, _ in self.sent}

    @property
    def bytes(self) -> int:
        return sum(count for _, count in self.sent)


@contextmanager
def served(folder: Path) -> Iterator[Served]:
    state = Served()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_HEAD(self) -> None:
            self.do_GET()

        def do_GET(self) -> None:
            state.asked.append(unquote(self.path).strip("/"))
            path = folder / unquote(self.path).strip("/")
            path = path / "index.html" if path.is_dir() else path
            if state.status != HTTPStatus.OK or not path.is_file():
                self._answer(state.status if state.status != HTTPStatus.OK else HTTPStatus.NOT_FOUND, b"")
                return
            if path.suffix != ".json":
                state.waiting.append(self.path)
                state.lets_go.wait(PATIENCE)
                state.waiting.remove(self.path)
            content = path.read_bytes()
            part = self._wanted(content)
            if self.command == "GET":
                state.sent.append((self.path.strip("/"), len(part)))
            self._answer(HTTPStatus.OK if part is content else HTTPStatus.PARTIAL_CONTENT, part)

        def _wanted(self, content: bytes) -> bytes:
            match = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
            if match is None:
                return content
            if not match[1]:
                return content[-int(match[2]) :]
            return content[int(match[1]) : int(match[2]) + 1 if match[2] else None]

        def _answer(self, status: int, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Content-Type", mimetypes.guess_type(self.path)[0] or "text/html")
            self.end_headers()
            if self.command == "GET":
                self.wfile.write(content)

        def log_message(self, format: str, *arguments: object) -> None:
            """Says nothing."""

    class Server(ThreadingHTTPServer):
        def handle_error(self, request: object, client_address: object) -> None:
            """A reader that has seen enough may hang up; all else is a mistake of the test."""
            if not isinstance(sys.exception(), ConnectionError):
                super().handle_error(request, client_address)  # type: ignore[arg-type]

    with Server(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        state.url = f"http://127.0.0.1:{server.server_port}"
        try:
            yield state
        finally:
            server.shutdown()
            thread.join()
