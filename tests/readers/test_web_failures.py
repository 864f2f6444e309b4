"""What fails on the way to a web server ends in one line that names cause and cure, and in nothing else."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import zarr

from support.patience import PATIENCE

CHILD = """
import sys
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.zarr_arrays import web_failures
from volsplat.mapshade_server.readers.zarr_arrays import zarr_place
from volsplat.protocol.text.errors import BadInput

zarr_place.ANSWER_SECONDS = 3
for url in sys.argv[1:]:
    try:
        reader = open_volume(url)
        reader.read(reader.description.geometry.box)
        print("read")
    except BadInput as refusal:
        print(refusal)
"""


class Web(ThreadingHTTPServer):
    """A Zarr at /ok; at /403 it is answered so, at /chunks/403 its chunks are."""

    daemon_threads = True

    def __init__(self, folder: Path) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.folder = folder
        self.ended = threading.Event()

    @property
    def address(self) -> str:
        return f"127.0.0.1:{self.server_port}"

    def handle_error(self, request: object, client_address: object) -> None:
        """Says nothing of those who hang up."""


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Web

    def do_GET(self) -> None:
        failure, _, name = self.path.strip("/").removeprefix("chunks/").partition("/v.zarr/")
        chunk = name.startswith("c/")
        if failure == "ok" or self.path.startswith("/chunks/") and not chunk:
            failure = ""
        path = self.server.folder / "v.zarr" / name
        match failure:
            case "":
                self._answer(200 if path.is_file() else 404, path.read_bytes() if path.is_file() else b"")
            case "silence":
                self.server.ended.wait(PATIENCE)
            case "broken":
                self.send_response(200)
                self.send_header("Content-Length", "100000")
                self.end_headers()
                self.wfile.write(b"x" * 100)
                self.close_connection = True
            case "login":
                self._answer(200, b"<html>Please log in</html>")
            case _:
                self._answer(int(failure), b"<html>no</html>")

    def _answer(self, status: int, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: object) -> None:
        """Says nothing."""


@pytest.fixture(scope="module")
def web(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Web]:
    folder = tmp_path_factory.mktemp("web")
    array = zarr.create_array(folder / "v.zarr", shape=(64, 64, 64), chunks=(16, 16, 16), dtype="uint8")
    array[...] = np.random.default_rng(1).integers(0, 255, array.shape, np.uint8)
    with Web(folder) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.ended.set()
        server.shutdown()
        thread.join()


FAILURES = {
    "403": "the server refuses to give it (403 Forbidden); check the address, or ask for access",
    "chunks/403": "the server refuses to give it (403 Forbidden); check the address, or ask for access",
    "401": "the server refuses to give it (401 Unauthorized); check the address, or ask for access",
    "404": "there is no Zarr here, none of zarr.json, .zgroup, .zarray; check the place, and download what is not Zarr",
    "500": "the server failed (500 Internal Server Error); try again later",
    "chunks/503": "the server failed (503 Service Unavailable); try again later",
    "chunks/429": "the server does not give it (429 Too Many Requests); check the place",
    "silence": "no answer for",
    "chunks/silence": "no answer for",
    "broken": "the connection broke off; try again",
    "chunks/broken": "the connection broke off; try again",
    "login": "what is there is no Zarr metadata, but perhaps a page to log in; check the place",
    "chunks/login": "cannot be read (its zstd frame is damaged); check the place",
}


def test_each_failure_ends_in_one_line_and_nothing_else(web: Web) -> None:
    urls = {f"http://{web.address}/{path}/v.zarr": cause for path, cause in FAILURES.items()}
    urls["http://no-such-host.invalid/v.zarr"] = "there is no host of this name; check the address and the network"
    urls[f"https://{web.address}/ok/v.zarr"] = "no secure connection can be made; check whether the address begins with"
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        urls[f"http://127.0.0.1:{nobody.getsockname()[1]}/v.zarr"] = "nothing answers at this address and port"
        done = subprocess.run(
            [sys.executable, "-c", CHILD, *urls, f"http://{web.address}/ok/v.zarr"],
            capture_output=True,
            encoding="utf-8",
            timeout=PATIENCE,
        )
    assert (done.returncode, done.stderr) == (0, "")
    *lines, last = done.stdout.splitlines()
    assert last == "read"
    for (url, cause), line in zip(urls.items(), lines, strict=True):
        assert line.startswith(f"{url}: {cause}"), line
