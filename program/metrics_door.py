"""Metrics for Prometheus by HTTP: `GET /metrics`, for who shows the bearer token of the door.

That token is the door's own, never the session's: HTTP is not encrypted, and who has read this one may read metrics.
"""

import hmac
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from secrets import token_hex
from socketserver import TCPServer
from typing import TYPE_CHECKING, Any

from volsplat.program.counts import COUNTED, Counts
from volsplat.program.extras import need
from volsplat.program.peak_memory import peak_memory
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import Address
from volsplat.protocol.wire.tokens import Token, find_token, new_token

if TYPE_CHECKING:
    from prometheus_client.core import Metric

PATIENCE = 5.0  # seconds for a request, after which whoever sends it is dropped
MOST_AT_ONCE = 8  # requests


def door_token(path: Path) -> Token:
    """The token in a file, which is made if it is missing. Raises BadInput."""
    if not path.exists():
        _make(path)
    found = find_token({}, path)
    assert found is not None
    return found


def _make(path: Path) -> None:
    """Whole from its first moment: servers of one machine, which share it, may start at once."""
    fresh = path.with_name(f"{path.name}-{token_hex(8)}")
    new_token().write(fresh)
    try:
        os.link(fresh, path)
    except FileExistsError:
        return  # another one's
    except OSError as error:
        raise BadInput(f"the token file {path} cannot be made: {error.strerror}; name another") from error
    finally:
        fresh.unlink()


class MetricsDoor:
    """Answers from when it is made until it is closed."""

    def __init__(self, address: Address, token: Token, counts: Callable[[], Counts]) -> None:
        """Raises BadInput where the address cannot be had, or without the extra [metrics]."""
        need("prometheus_client", "--metrics", "metrics")
        from prometheus_client import CollectorRegistry

        registry = CollectorRegistry(auto_describe=False)
        registry.register(_Collector(counts))
        try:
            self._server = _Server(address, token, registry)
        except OSError as error:
            raise BadInput(f"--metrics {address}: {error.strerror}; choose another address") from error
        threading.Thread(target=self._server.serve_forever, name="metrics", daemon=True).start()

    @property
    def address(self) -> Address:
        host, port = self._server.server_address[:2]
        return Address(str(host), int(port))

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


class _Collector:
    """What prometheus_client asks at each scrape."""

    def __init__(self, counts: Callable[[], Counts]) -> None:
        self._counts = counts

    def collect(self) -> "Iterator[Metric]":
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        sums = self._counts().sums()
        for name, counted in COUNTED.items():
            family = CounterMetricFamily(
                f"volsplat_{name}", counted.what, labels=[counted.label] if counted.label else None
            )
            for (what, of), amount in sums.items():
                if what == name:
                    family.add_metric([of] if of else [], amount)
            yield family
        yield GaugeMetricFamily("volsplat_peak_memory_bytes", "Most memory that the process had", peak_memory())


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, address: Address, token: Token, registry: Any) -> None:
        self.token, self.registry = token, registry
        self._room = threading.BoundedSemaphore(MOST_AT_ONCE)
        self.address_family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
        super().__init__((address.host, address.port), _Handler)

    def server_bind(self) -> None:
        """Without what HTTPServer does beside: it looks the host's name up, which may take long."""
        TCPServer.server_bind(self)

    def process_request(self, request: Any, client_address: Any) -> None:
        if not self._room.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except RuntimeError:  # the system has no thread left to give; later it may
            self._room.release()
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        late = threading.Timer(PATIENCE, _hang_up, [request])
        late.daemon = True
        try:
            late.start()
            super().process_request_thread(request, client_address)
        except RuntimeError:  # the system has no thread left to give for who would hang up
            self.shutdown_request(request)
        finally:
            late.cancel()
            self._room.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Whoever breaks off a request is no event."""


def _hang_up(connection: socket.socket) -> None:
    with suppress(OSError):  # it is closed
        connection.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "volsplat", ""

    def do_GET(self) -> None:
        from prometheus_client.exposition import choose_encoder

        if not self._admitted():
            self._answer(401, b"give the door's token: Authorization: Bearer TOKEN\n", "text/plain")
        elif self.path.partition("?")[0] != "/metrics":
            self._answer(404, b"there is /metrics only\n", "text/plain")
        else:
            encoder, kind = choose_encoder(self.headers.get("Accept", ""))
            self._answer(200, encoder(self.server.registry), kind)

    def _admitted(self) -> bool:
        shown = self.headers.get("Authorization", "").encode("latin-1", "replace")
        return hmac.compare_digest(shown, b"Bearer " + self.server.token.key)

    def _answer(self, status: int, body: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        if status == 401:
            self.send_header("WWW-Authenticate", "Bearer")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """A scrape is no event."""
