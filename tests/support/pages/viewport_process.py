"""Plays the client's process for a viewport under test: a real WebSocket server that sends pictures and hears all.

A test module imports the fixtures `shown` and `viewport_server` besides those of `browser`, and names them in `__all__`
likewise.
"""

from __future__ import annotations

import asyncio
import io
import json
import threading
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
from PIL import Image
from playwright.sync_api import Locator, Page
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from support.pages.browser import serving
from support.patience import PATIENCE
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.viewport.viewport_messages import PictureHeader, ProcessMessage

Message = dict[str, Any]
Colour = tuple[int, int, int]

VOLUME: Message = {
    "type": "volume",
    "name": "phantom",
    "dims": [64, 48, 40],
    "index_to_upright": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]],
    "reference_spacing": 2.0 ** (1 / 3),
    "unit": "mm",
    "sides": {"front": "A", "back": "P", "left": "L", "right": "R", "top": "S", "bottom": "I"},
    "density_name": "density",
    "strength_name": "gradient strength",
    "value_unit": "",
    "axes": None,
    "scales": [{"name": "", "unit": "mm", "length": 1.0}],
}
FRONT = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
VIEW: Message = {"rotation": FRONT, "zoom": 5.0, "center": [31.5, 23.5, 19.5]}
FIT: Message = {"zoom": 6.5, "center": [30.0, 24.0, 18.5]}
SIZE = (640, 480)

_PAGE = """<!doctype html><meta charset="utf-8"><title>viewport</title>
<link rel="stylesheet" href="/static/theme.css"><link rel="stylesheet" href="/static/viewport/viewport.css">
<style>body { margin: 0 } #host { width: 640px; height: 480px; background: black }</style>
<div id="host"></div>
<script type="module">
  import { Viewport } from "/static/viewport/viewport.js";
  import { ViewportSocket } from "/static/viewport/viewport_socket.js";
  const url = new URL("/viewport?tab=t1", location.href.replace("http", "ws"));
  const socket = new ViewportSocket(url, new URL("/alive", location.href));
  window.volsplatViewport = new Viewport(document.getElementById("host"), socket);
  socket.open();
</script>"""


class ViewportProcess:
    """An ASGI application (see `application`). Everything here may be called from the test's thread."""

    def __init__(self) -> None:
        self.heard: list[Message] = []
        self.refuses = False  # as a process that does not know the page
        self._changed = threading.Condition()
        self._socket: WebSocket | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._number = 0
        self.application = Starlette(
            routes=[
                Route("/", self._page),
                Route("/alive", self._nothing),
                WebSocketRoute("/viewport", self._viewport),
                Mount("/static", StaticFiles(directory=STATIC)),
            ]
        )

    def begin_anew(self) -> None:
        """As if just made: what was said, and who said it, is forgotten."""
        with self._changed:
            self.heard.clear()
            self.refuses = False
            self._socket = None
            self._number = 0

    def heard_of(self, kind: str) -> list[Message]:
        with self._changed:
            return [message for message in self.heard if message["type"] == kind]

    def wait_until(self, holds: Callable[[], bool], what: str) -> None:
        with self._changed:
            if not self._changed.wait_for(holds, PATIENCE):
                raise AssertionError(f"the page did not {what}; it said {self.heard[-20:]}")

    def wait_for(self, kind: str, count: int = 1) -> Message:
        """The last of at least `count` messages of a kind."""
        self.wait_until(lambda: len(self.heard_of(kind)) >= count, f"say {count} x {kind}")
        return self.heard_of(kind)[-1]

    def wait_for_probe(self, count: int = 1) -> Message:
        """What the answer to the last of at least `count` probes begins with."""
        asked = self.wait_for("probe", count)
        return {key: asked[key] for key in ("type", "x", "y")}

    def wait_for_settled(self, kind: str = "view") -> Message:
        """The last message of a kind, once it says that the person is done."""
        self.wait_until(lambda: any(m["settled"] for m in self.heard_of(kind)[-1:]), f"settle its {kind}")
        return self.heard_of(kind)[-1]

    def wait_for_settled_after(self, event: int) -> Message:
        """The settled view that ends what the person did after the numbered event."""
        self.wait_until(
            lambda: any(view["settled"] and view["event"] > event for view in self.heard_of("view")),
            f"settle after event {event}",
        )
        return self.heard_of("view")[-1]

    def forget(self) -> None:
        with self._changed:
            self.heard.clear()

    def say(self, message: Message) -> None:
        """Raises ValidationError for what the process never says."""
        self._in_loop(self._open().send_text(_encoded(message, ProcessMessage).decode()))

    def say_scene(self, *, by: str = "t1", settled: bool = True, view: Message | None = None, **others: Any) -> None:
        bounds = others.pop("bounds", {"low": [0, 0, 0], "high": VOLUME["dims"]})
        size = others.pop("size", SIZE)
        told = {"revision": 1, "by": by, "settled": settled, "view": view or VIEW, "bounds": bounds, "edges": False}
        fit = others.pop("fit", FIT)
        self.say({"type": "scene", **told, "fit": fit, "width": size[0], "height": size[1]})

    def show(self, picture: bytes | None = None, *, number: int | None = None, **header: Any) -> int:
        """Send a picture; numbers rise by themselves. Returns its number."""
        self._number = self._number + 1 if number is None else number
        told = {
            "number": self._number,
            "revision": 1,
            "event": 0,
            "step": "F",
            "one_in": 1,
            "complete": True,
            "last": True,
            "seconds": 0.01,
            "next": None,
            "width": SIZE[0],
            "height": SIZE[1],
            "view": VIEW,
            "notice": "",
            "missing": [],
            "undrawn": [],
            **header,
        }
        text = _encoded(told, PictureHeader)
        data = len(text).to_bytes(4, "little") + text + (picture or plain((40, 80, 120)))
        self._in_loop(self._open().send_bytes(data))
        return self._number

    def hang_up(self) -> None:
        """Close the connection from this side."""
        socket = self._open()
        with self._changed:
            self._socket = None
        self._in_loop(socket.close())

    def wait_for_page(self) -> None:
        """Until a page is connected and has said its size."""
        self.wait_until(lambda: self._socket is not None and self.heard_of("size") != [], "connect")

    def _open(self) -> WebSocket:
        self.wait_until(lambda: self._socket is not None, "connect")
        assert self._socket is not None
        return self._socket

    def _in_loop(self, work: Any) -> None:
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)

    async def _page(self, request: Request) -> HTMLResponse:
        return HTMLResponse(_PAGE)

    async def _nothing(self, request: Request) -> Response:
        return Response(status_code=403 if self.refuses else 204)

    async def _viewport(self, socket: WebSocket) -> None:
        if self.refuses:
            await socket.close()  # not accepted: an answer of 403
            return
        await socket.accept()
        with self._changed:
            self._socket, self._loop = socket, asyncio.get_running_loop()
            self._changed.notify_all()
        try:
            while True:
                message = json.loads(await socket.receive_text())
                with self._changed:
                    if socket is self._socket:  # and not of a page that is gone
                        self.heard.append(message)
                        self._changed.notify_all()
        except WebSocketDisconnect:
            return


def _encoded(message: Message, kind: Any) -> bytes:
    return msgspec.json.encode(msgspec.convert(message, kind))


def plain(colour: Colour, size: tuple[int, int] = SIZE) -> bytes:
    """A picture of one colour, as PNG."""
    out = io.BytesIO()
    Image.new("RGB", size, colour).save(out, "PNG")
    return out.getvalue()


@pytest.fixture(scope="module")
def viewport_server() -> Iterator[tuple[ViewportProcess, str]]:
    """A process and its address: one for all tests of a module, so that the browser keeps the scripts from there."""
    process = ViewportProcess()
    with serving(process.application) as url:
        yield process, url


@pytest.fixture
def shown(browser_page: Page, viewport_server: tuple[ViewportProcess, str]) -> ShownViewport:
    process, url = viewport_server
    process.begin_anew()
    return ShownViewport(browser_page, process, url)


class ShownViewport:
    """A viewport of SIZE at the top left of a tab, after its first picture, and its process."""

    def __init__(self, page: Page, process: ViewportProcess, url: str) -> None:
        self.page = page
        self.process = process
        page.goto(url)
        process.wait_for_page()
        process.say(VOLUME)
        process.say_scene()
        self.show_and_wait()
        process.forget()

    @property
    def canvas(self) -> Locator:
        return self.page.locator("#host .vs-picture")

    def show_and_wait(self, picture: bytes | None = None, **header: Any) -> int:
        """Send a picture and wait until the page says that it has seen it, and so all that was said before."""
        number = self.process.show(picture, **header)
        self.process.wait_until(
            lambda: any(said["number"] == number for said in self.process.heard_of("shown")), f"acknowledge {number}"
        )
        return number

    def colour_at(self, x: int, y: int) -> Colour:
        """Of the canvas, in its own pixels."""
        r, g, b, _ = self.canvas.evaluate(
            "(canvas, [x, y]) => [...canvas.getContext('2d').getImageData(x, y, 1, 1).data]", [x, y]
        )
        return (r, g, b)

    def shown_numbers(self) -> list[int]:
        numbers: list[int] = self.page.evaluate("volsplatViewport.log.map(({ number }) => number)")
        return numbers

    def wait_for_the_last_to_settle(self) -> Message:
        """The settled view that ends all that the person has done."""
        self.frames(2)  # within which it is sent
        event: int = self.page.evaluate("volsplatViewport.sent.at(-1).event")
        return self.process.wait_for_settled_after(event - 1)

    def frames(self, count: int) -> None:
        """Let the page draw that many animation frames."""
        self.page.evaluate(
            """async (count) => {
                for (let n = 0; n < count; n++) await new Promise(requestAnimationFrame);
            }""",
            count,
        )
