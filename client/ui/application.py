"""The web application behind the page: what is served where, and for how long."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager

import nicegui
import uvicorn
from fastapi import FastAPI
from nicegui import Client, context, core, run, ui
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.ui.controls.kept_events import take_events_once
from volsplat.client.ui.doors.admission import Admission
from volsplat.client.ui.doors.behind_proxy import BehindProxy
from volsplat.client.ui.doors.gate import Gate
from volsplat.client.ui.doors.handed_files import FILES_PATH, handed_file
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.script_bundle import BUNDLES_PATH, ScriptBundles
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.doors.strict_answers import ScriptNonces, StrictHeaders
from volsplat.client.ui.doors.waiting_page import EARLY_PATH, WAITING_PATH
from volsplat.client.ui.opening.shown_volume import ShownVolume
from volsplat.client.ui.viewing.saving import (
    LARGEST_UPLOAD,
    SCENE_PARAMETER,
    VOLUME_PARAMETER,
    check_link_is_of,
    scene_from_link,
)
from volsplat.client.ui.viewport.early_picture import early_image
from volsplat.client.ui.viewport.viewport_link import serve_viewport, turn_away
from volsplat.protocol.text.errors import BadInput

SHUTDOWN_SECONDS = 1  # for open sockets, at the end
LONGEST_ADDRESS = 1 << 18  # bytes: a link may hold four tables drawn freehand
LARGEST_FORM = 1 << 16  # bytes around a file that is uploaded
SMALLEST_COMPRESSED = 500  # bytes
COMPRESSION = 4  # 1 to 9; more takes three times as long for a twentieth of the bytes
ALIVE_PATH = "/alive"  # where a page asks whether anybody is there
STATIC_PATH = "/volsplat/static"
MODULES_PATH = f"/_nicegui/{nicegui.__version__}/esm"  # the same, as components import it
CHECK_SECONDS = 1.0  # between looks at whether a page is open
CUT_SECONDS = 10.0  # after about which process and page take a line that carries nothing for cut
RECONNECT_SECONDS = 60.0  # that a page may be cut off, and then goes on as it was; it is loaded anew after more
LOADING_SECONDS = 30.0  # that a browser may take from the page to its viewport


class _Server(uvicorn.Server):
    """Leaves signals to whoever runs it: raised within its loop, they would come out as tracebacks."""

    def __init__(self, config: uvicorn.Config, end_session: Callable[[], None]) -> None:
        super().__init__(config)
        self._end_session = end_session

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """As it is; the session ends meanwhile, since either may have to wait for a peer that does not answer."""
        ended = asyncio.create_task(asyncio.to_thread(self._end_session))
        await super().shutdown(sockets)
        await ended

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


class OpenPages:
    """How many viewports are open, and since when none is or is on its way."""

    def __init__(self) -> None:
        self._open = 0
        self._none_since = time.monotonic()

    def coming(self) -> None:
        """Somebody has asked for the page. Its viewport opens once the browser has all that the page is made of."""
        self._none_since = max(self._none_since, time.monotonic() + LOADING_SECONDS)

    @asynccontextmanager
    async def one_more(self) -> AsyncIterator[None]:
        closed = self.opened()
        try:
            yield
        finally:
            closed()

    def follow(self, client: Client) -> None:
        """A page without a viewport is open as long as it is connected."""
        closed: list[Callable[[], None]] = []  # one while it is

        def connected() -> None:
            if not closed:
                closed.append(self.opened())

        def gone() -> None:
            if closed:
                closed.pop()()

        def disconnected() -> None:
            if not client.has_socket_connection:  # it may be connected anew before the old line's end is heard of
                gone()

        client.on_connect(connected)
        client.on_disconnect(disconnected)
        client.on_delete(gone)

    def opened(self) -> Callable[[], None]:
        """One more is open, until what is returned is called."""
        self._open += 1
        return self._closed

    def _closed(self) -> None:
        self._open -= 1
        self._none_since = time.monotonic()

    def none_for(self, seconds: float) -> bool:
        return self._open == 0 and time.monotonic() - self._none_since >= seconds


class Application:
    """Serves what is shown at the address until told to stop, or until no page has been open for `grace` seconds."""

    def __init__(self, shown: ShownVolume, build_page: Callable[[], None], address: PageAddress, grace: float) -> None:
        """`build_page` builds that of what is shown now."""
        self._shown = shown
        self._build_page = build_page
        self._pages = OpenPages()
        self._grace = grace
        bundles = ScriptBundles()
        application = self._routed(bundles)
        _begin_anew()
        ui.page("/", reconnect_timeout=RECONNECT_SECONDS)(self._page)
        ui.run_with(
            application,
            title="volsplat",
            dark=None,
            tailwind=False,
            show_welcome_message=False,
            reconnect_timeout=CUT_SECONDS,
            gzip_middleware_factory=None,  # nonces come first
        )
        take_events_once()
        self._bound = address.bound
        self._server = _Server(
            uvicorn.Config(
                _guarded(application, bundles, address.admission),
                log_config=None,  # as everything else is logged
                server_header=False,
                proxy_headers=False,  # who asks is who connects, whatever a header says
                timeout_graceful_shutdown=SHUTDOWN_SECONDS,
                ws_max_size=1 << 16,  # a page says little
                ws_per_message_deflate=False,  # pictures are compressed already
                h11_max_incomplete_event_size=LONGEST_ADDRESS,
            ),
            end_session=shown.close,
        )
        self.ended_by_grace = False

    def _routed(self, bundles: ScriptBundles) -> FastAPI:
        """All that is served, but for the page itself, which is NiceGUI's."""
        application = FastAPI(lifespan=self._lifespan, openapi_url=None, docs_url=None, redoc_url=None)
        application.mount(STATIC_PATH, StaticFiles(directory=STATIC))
        application.add_api_websocket_route("/viewport", self._viewport)
        for path, answer in (
            (f"{BUNDLES_PATH}/{{name}}", bundles.script),
            (f"{FILES_PATH}/{{key}}", handed_file),
            (EARLY_PATH, self._early_picture),
            (WAITING_PATH, _nothing_to_say),
            (ALIVE_PATH, _nothing_to_say),
        ):
            application.add_api_route(path, answer, include_in_schema=False, response_model=None)
        return application

    def run(self, on_ready: Callable[[], None]) -> None:
        """Serve; `on_ready` is called once the port is open. What Ctrl-C and its like raise is raised at the end."""
        self._on_ready = on_ready
        with interrupts_held(self._end), _without_processes():
            if _a_loop_runs_here():
                with ThreadPoolExecutor(1, "page") as apart:
                    apart.submit(self._server.run, [self._bound]).result()
            else:
                self._server.run([self._bound])

    def _end(self) -> None:
        self._server.should_exit = True

    @asynccontextmanager
    async def _lifespan(self, application: FastAPI) -> AsyncIterator[None]:
        watch = asyncio.create_task(self._watch())
        try:
            async with self._shown.drawn():
                yield
        finally:
            watch.cancel()

    async def _watch(self) -> None:
        while not self._server.started:
            await asyncio.sleep(0.01)
        self._on_ready()
        while not self._pages.none_for(self._grace):
            await asyncio.sleep(CHECK_SECONDS)
        self.ended_by_grace = True
        self._end()

    async def _viewport(self, socket: WebSocket, tab: str, volume: int | None = None) -> None:
        """The page says of which volume it is: a tab that was away may have missed that another one is shown."""
        viewing = self._shown.viewing
        if viewing is None or volume not in (None, viewing.number):
            await turn_away(socket)
            return
        async with self._pages.one_more():
            await serve_viewport(viewing, socket, tab)

    async def _early_picture(self) -> Response:
        """Nothing where there is none yet: the viewport shows one later."""
        viewing = self._shown.viewing
        image = None if viewing is None else await early_image(viewing)
        return await _nothing_to_say() if image is None else Response(image, media_type="image/jpeg")

    def _page(self, request: Request) -> Response | None:
        """The page. A link to a scene puts that in force and leads to the page without it, which may be loaded anew."""
        viewing = self._shown.viewing
        link = request.query_params.get(SCENE_PARAMETER)
        if viewing is None:
            self._pages.follow(context.client)
        elif link is not None:
            try:
                check_link_is_of(request.query_params.get(VOLUME_PARAMETER), viewing.volume.description)
                viewing.show_scene(scene_from_link(link, viewing.default_scene))
                return RedirectResponse(".", status_code=303)
            except (BadInput, ValueError) as error:
                ui.notify(str(error), type="warning", timeout=0, close_button=True)
        self._pages.coming()
        self._build_page()
        return None


def _guarded(application: FastAPI, bundles: ScriptBundles, admission: Admission) -> BehindProxy:
    """The application behind all that a request passes first."""
    compressed = GZipMiddleware(ScriptNonces(application, bundles.in_page), SMALLEST_COMPRESSED, COMPRESSION)
    gate = Gate(compressed, admission, LARGEST_UPLOAD + LARGEST_FORM)
    prefix = admission.behind.prefix if admission.behind else ""
    kept = {f"{prefix}{path}": "no-cache" for path in (STATIC_PATH, MODULES_PATH)}
    return BehindProxy(StrictHeaders(gate, kept), admission.behind)


def _begin_anew() -> None:
    """Let go of what NiceGUI, which is one for a whole process, keeps of a page that was served before.

    Raises BadInput while it serves one.
    """
    if not core.app.is_stopped:
        raise BadInput("this process serves a page already; end that one first, or use another process")
    core.app.user_middleware.clear()
    core.app.middleware_stack = None
    core.sio.eio.start_service_task = True  # the one that was started has ended with its loop


@contextmanager
def _without_processes() -> Iterator[None]:
    """Without the pool for them that NiceGUI starts with: nothing here uses it, and it needs room in /dev/shm."""
    setup = run.setup
    run.setup = lambda: None
    try:
        yield
    finally:
        run.setup = setup


def _a_loop_runs_here() -> bool:
    """Whether this thread is within an event loop, as a notebook's cells are: then it cannot run another one."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


async def _nothing_to_say() -> Response:
    """Nobody need wait any more, and somebody is there."""
    return Response(status_code=204)
