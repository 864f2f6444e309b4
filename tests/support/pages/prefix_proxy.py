"""A proxy that shows a server under a prefix of its own, as JupyterHub does, and refuses all that is not below it."""

from __future__ import annotations

import re
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

from support.patience import PATIENCE

_REQUEST = re.compile(rb"([A-Z]+) (\S+) (HTTP/1\.[01]\r\n)")
_CONNECTION = re.compile(rb"\r\nconnection: *keep-alive", re.IGNORECASE)
_UPGRADING = re.compile(rb"\r\nconnection: *upgrade", re.IGNORECASE)
_UPGRADE = re.compile(rb"(?:upgrade:|sec-websocket-)[^\r]*\r\n", re.IGNORECASE)
_NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


@dataclass
class PrefixProxy:
    """`cuts` says whether the server behind it gets paths without the prefix.

    One that `buffers` sends answers once they are whole, and passes no WebSockets on, as proxies do by themselves.
    """

    prefix: str
    cuts: bool
    listening: socket.socket
    buffers: bool = False
    target: int = 0  # the server's port, set before anything is asked
    outside: list[str] = field(default_factory=list)  # paths that were asked for and are not below the prefix
    _open: set[socket.socket] = field(default_factory=set)
    _threads: list[threading.Thread] = field(default_factory=list)

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.listening.getsockname()[1]}{self.prefix}/"

    def serve(self) -> None:
        """A thread for each connection, until the listening socket is shut down."""
        with suppress(OSError):
            while True:
                browser, _ = self.listening.accept()
                self._open.add(browser)
                self._begin(self._answer, browser)

    def end(self) -> None:
        """End what is open still, and wait for its threads."""
        for one in list(self._open):
            with suppress(OSError):  # it has ended by itself
                one.shutdown(socket.SHUT_RDWR)
        for thread in list(self._threads):
            thread.join(PATIENCE)

    def _begin(self, work: Callable[..., None], *sockets: socket.socket) -> threading.Thread:
        thread = threading.Thread(target=work, args=sockets, daemon=True)
        self._threads.append(thread)
        thread.start()
        return thread

    def _answer(self, browser: socket.socket) -> None:
        """One request for each connection."""
        with browser, suppress(OSError):
            head = b""
            while b"\r\n\r\n" not in head:
                if not (data := browser.recv(1 << 16)):
                    return
                head += data
            asked = _REQUEST.match(head)
            assert asked is not None, head
            path = asked[2].decode()
            if not path.startswith(self.prefix + "/"):
                self.outside.append(path)
                browser.sendall(_NOT_FOUND)
                return
            passed = path.removeprefix(self.prefix) if self.cuts else path
            rest = _CONNECTION.sub(b"\r\nConnection: close", head[asked.end() - 2 :])[2:]
            if self.buffers:
                rest = _UPGRADING.sub(b"\r\nConnection: close", _UPGRADE.sub(b"", rest))
            self._pass(asked[1] + b" " + passed.encode() + b" " + asked[3] + rest, browser)

    def _pass(self, head: bytes, browser: socket.socket) -> None:
        with socket.create_connection(("127.0.0.1", self.target)) as server:
            self._open.add(server)
            server.sendall(head)
            sending = self._begin(_relay, browser, server)
            _relay(server, browser, whole=self.buffers)
            for one in (browser, server):
                with suppress(OSError):  # the other end may have closed it
                    one.shutdown(socket.SHUT_RDWR)
            sending.join(PATIENCE)


@contextmanager
def prefix_proxy(prefix: str, *, cuts: bool, buffers: bool = False) -> Iterator[PrefixProxy]:
    """Serve on a free port of loopback."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        proxy = PrefixProxy(prefix, cuts, listening, buffers)
        accepting = threading.Thread(target=proxy.serve, name="prefix proxy", daemon=True)
        accepting.start()
        try:
            yield proxy
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            accepting.join(PATIENCE)
            proxy.end()


def _relay(source: socket.socket, target: socket.socket, whole: bool = False) -> None:
    """What comes is sent on as it comes, or all of it at the end."""
    held = b""
    with suppress(OSError):
        while data := source.recv(1 << 16):
            if whole:
                held += data
            else:
                target.sendall(data)
        target.sendall(held)
