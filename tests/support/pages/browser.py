"""A real browser for tests of the page: Debian's Chromium, driven by Playwright, and a server for what it loads.

A test module imports the fixtures that it wants by name, `browser` among them since `browser_page` needs it, and says
`__all__ = ["browser", "browser_page"]`, which tells ruff that they are used. (`chromium` is conftest's: what a module
imports is its own.)
"""

from __future__ import annotations

import asyncio
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest

from support.patience import PATIENCE
from volsplat.bench.chromium_tab import BROWSERS

if TYPE_CHECKING:
    from playwright.sync_api import (
        Browser,
        BrowserContext,
        BrowserType,
        ConsoleMessage,
        Error,
        Page,
        Request,
        ViewportSize,
    )
    from starlette.types import ASGIApp

_POLICY = "Content Security Policy"
# Code that runs a few times is not worth what it costs to compile it well.
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--js-flags=--no-opt --no-maglev")
WINDOW: ViewportSize = {"width": 1280, "height": 800}
_NOWHERE = (-1, -1)  # beside the page, where the pointer is before it is moved
_GONE = 500  # milliseconds, within which what is closed mostly is; who takes longer is only loaded anew
_HELD_KEYS = ("Control", "Shift", "Alt")


class Chromium:
    """Headless Chromium, started when first lent, and anew where it has ended. Debian's shell does a page for half the
    work.

    Playwright's loop waits in a greenlet of its own and yet is this thread's running one, beside which other tests
    could run none: it is hidden from them.
    """

    def __init__(self, executable: str, kinds: BrowserType) -> None:
        self._executable = executable
        self._kinds = kinds
        self._loop = asyncio.get_running_loop()
        self._launched: Browser | None = None
        self._lasting: dict[str, BrowserContext] = {}
        self.hide()

    @contextmanager
    def lent(self) -> Iterator[Browser]:
        self.show()
        try:
            if self._launched is None or not self._launched.is_connected():
                self._launched = self._kinds.launch(executable_path=self._executable, args=ARGUMENTS)
                self._lasting.clear()
            yield self._launched
        finally:
            self.hide()

    def lasting_context(self, lent: Browser, url: str) -> BrowserContext:
        """One for tests of several modules, for as long as the browser lasts that was lent them."""
        if url not in self._lasting:
            self._lasting[url] = _patient(lent, viewport=WINDOW)
        return self._lasting[url]

    def close(self) -> None:
        self.show()
        if self._launched is not None:
            self._launched.close()

    def show(self) -> None:
        asyncio._set_running_loop(self._loop)

    def hide(self) -> None:
        asyncio._set_running_loop(None)


def chromium_executable() -> str:
    """Where Chromium lies; without one the test is skipped."""
    executable = next(filter(None, map(shutil.which, reversed(BROWSERS))), None)
    if executable is None:
        pytest.skip("the browser tests need Chromium: apt install chromium-headless-shell, or chromium")
    return executable


@pytest.fixture(scope="session")
def chromium() -> Iterator[Chromium]:
    """One for all tests of a process: to start Playwright and a browser takes as much as to load a page."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright (extra dev)")
    executable = chromium_executable()
    playwright.expect.set_options(timeout=1000 * PATIENCE)
    with playwright.sync_playwright() as running:
        started = Chromium(executable, running.chromium)
        yield started
        started.close()


@pytest.fixture(scope="module")
def browser(chromium: Chromium) -> Iterator[Browser]:
    """It, with a first context, that of `browser_page`, in which what tests load from one server is loaded and compiled
    once. It is emptied after each module, and its tab closed: Playwright never forgets what to do with WebSockets.
    """
    with chromium.lent() as lent:
        context = lent.contexts[0] if lent.contexts else _patient(lent, viewport=WINDOW)
        yield lent
        _forget(context, _origins(context))
        close_tab(_tab(context))


@pytest.fixture
def browser_page(browser: Browser) -> Iterator[Page]:
    """An empty tab of 1280x800, of a browser that remembers nothing of the tests before but files that may be kept.

    It is the same tab for all tests of a module: in a new one, whose scripts no process has compiled, the page takes
    nearly twice the work to load. The test fails if a script of the page fails, or breaks the page's own policy.
    """
    origins: set[str] = set()

    def note_origin(request: Request) -> None:
        if request.is_navigation_request():
            origins.add(_origin(request.url))

    context = browser.contexts[0]
    if _origins(context):  # what `kept_as_loaded` has kept
        _forget(context, _origins(context))
    page = _tab(context)
    context.on("request", note_origin)
    with no_failures(page):
        yield page
        _forget(context, origins)
        context.remove_listener("request", note_origin)


@contextmanager
def no_failures(page: Page) -> Iterator[None]:
    """Fails at the end if a script of the page has failed meanwhile, or broken the page's own policy."""
    failures: list[str] = []

    def note_failure(error: Error) -> None:
        failures.append(f"{error.message}\n{error.stack}")

    def note_breach(told: ConsoleMessage) -> None:
        if _POLICY in told.text:
            failures.append(told.text)

    page.on("pageerror", note_failure)
    page.on("console", note_breach)
    try:
        yield
    finally:
        page.remove_listener("pageerror", note_failure)
        page.remove_listener("console", note_breach)
    assert not failures, "a script of the page failed:\n" + "\n".join(failures)


class KeptPage:
    """A tab that keeps what it has loaded from test to test, for tests that can put back what they changed.

    To load a page is most of what a short test of it costs.
    """

    def __init__(self, context: BrowserContext) -> None:
        self._context = context
        self._page: Page | None = None
        self._last_test = ""

    def page(self, test: str) -> tuple[Page, bool]:
        """The tab, as it was left, and whether it is empty: for the first test, and for one that is tried again."""
        kept = None if test == self._last_test else self._page
        page = self._page = kept or self._context.new_page()
        self._last_test = test
        for other in self._context.pages:
            if other is not page:
                close_tab(other)
        _let_go(page)
        return page, kept is None


@pytest.fixture(scope="module")
def kept_page(browser: Browser) -> Iterator[KeptPage]:
    with patient_context(browser, viewport=WINDOW) as context:
        yield KeptPage(context)


# What is seen but for what scenes, frames and servers change, scrolled to the beginning; what is kept for the page.
_LOOK = """() => {
    const all = [...document.querySelectorAll("body *")];
    for (const part of all) if (part.scrollTop !== 0) part.scrollTop = 0;
    const marks = ".vs-edges, .vs-overlay, .vs-corner, .vs-cube";
    const ofScenes = ".vs-step, .vs-foot, [aria-label=undo], [aria-label=redo]";
    const changing = `${marks}, ${ofScenes}, .q-ripple, .q-loading-bar`;
    const seen = all.filter((part) => part.checkVisibility() && !part.closest(changing)).map((part) => {
        const { x, y, width, height } = part.getBoundingClientRect();
        const states = [part.ariaExpanded, part.ariaPressed, part.ariaChecked, part.ariaValueNow];
        const text = part.childElementCount === 0 ? part.textContent : "";
        const shown = [part.tagName, part.getAttribute("class"), text, part.value, part.checked];
        return width * height === 0 ? [] : [...shown, ...states, x, y, width, height];
    }).filter((told) => told.length !== 0);
    return JSON.stringify([location.href, innerWidth, innerHeight, seen, { ...localStorage }, { ...sessionStorage }]);
}"""


@contextmanager
def kept_as_loaded(
    context: BrowserContext,
    url: str,
    test: str,
    load: Callable[[Page], object],
    put_back: Callable[[Page], object] = lambda _: None,
) -> Iterator[Page]:
    """A context's only tab with what is at the address, kept from test to test while it looks as just loaded.

    To load it is most of what a short test of it costs. It is loaded anew if the last test left it otherwise, though
    what it changed in the process was put back, and for a test that is tried again.
    """
    _close_others(context)
    if not (_origin(_tab(context).url) == _origin(url) and _is_as_loaded(_tab(context), test, put_back)):
        _forget(context, _origins(context))
        load(_tab(context))
        _tab(context).evaluate(f"() => {{ window.asLoaded = ({_LOOK})(); }}")
    page = _tab(context)
    page.evaluate("(test) => { window.keptFor = test; }", test)
    with no_failures(page):
        yield page


def _is_as_loaded(page: Page, test: str, put_back: Callable[[Page], object]) -> bool:
    """Whether it looks so once the hand has let go of it. One that crashed, or is on its way elsewhere, does not."""
    from playwright.sync_api import Error

    with suppress(Error):
        page.context.clear_permissions()
        _let_go(page)
        if page.evaluate("(test) => 'asLoaded' in window && window.keptFor !== test", test):
            put_back(page)
            page.wait_for_function(f"() => window.asLoaded === ({_LOOK})()", timeout=_GONE, polling=100)
            return True
    return False


def _let_go(page: Page) -> None:
    """Nothing has the focus, no key or button is held, and the pointer is beside the page."""
    page.evaluate("() => document.activeElement?.blur()")
    page.mouse.up()
    page.mouse.move(*_NOWHERE)
    for key in _HELD_KEYS:
        page.keyboard.up(key)


def _origins(context: BrowserContext) -> set[str]:
    """Of what its tabs show."""
    return {_origin(page.url) for page in context.pages if page.url.startswith("http")}


def _origin(url: str) -> str:
    return "{0.scheme}://{0.netloc}".format(urlsplit(url))


def _tab(context: BrowserContext) -> Page:
    """Its first tab, or a new one."""
    return context.pages[0] if context.pages else context.new_page()


def _close_others(context: BrowserContext) -> None:
    """All tabs but the first."""
    for page in context.pages[1:]:
        close_tab(page)


def _forget(context: BrowserContext, origins: Iterable[str]) -> None:
    """Have it as it was when it began, with one tab, which is empty."""
    _close_others(context)
    _empty(_tab(context))
    storage = context.new_cdp_session(_tab(context))
    for origin in origins:
        storage.send("Storage.clearDataForOrigin", {"origin": origin, "storageTypes": "local_storage"})
    storage.detach()
    context.clear_cookies()
    context.clear_permissions()


def _empty(page: Page) -> None:
    """Leave what it shows, and put back what a tab keeps from page to page; close it if it cannot be left."""
    from playwright.sync_api import Error

    page.unroute_all(behavior="ignoreErrors")
    try:
        if page.url.startswith("http"):
            page.evaluate("() => sessionStorage.clear()")
        page.goto("about:blank")
    except Error:  # it is just loading another page
        close_tab(page)
        return
    _let_go(page)
    page.set_viewport_size(WINDOW)


def close_tab(page: Page) -> None:
    """Chromium may forget to close a tab that is just being loaded anew; `Page.close` would wait for it for ever."""
    from playwright.sync_api import TimeoutError

    deadline = time.monotonic() + PATIENCE
    while not page.is_closed():
        assert time.monotonic() < deadline, "a tab never closed"
        with suppress(TimeoutError), page.expect_event("close", timeout=1000):
            page.close(run_before_unload=True)  # the only way that does not wait


@contextmanager
def patient_context(browser: Browser, **options: Any) -> Iterator[BrowserContext]:
    """Tabs as of a browser started anew, which wait as tests do, and move nothing by themselves unless asked to."""
    with _patient(browser, **options) as context:
        yield context


def _patient(browser: Browser, **options: Any) -> BrowserContext:
    """Each frame of an animation takes as much as a test's click."""
    context = browser.new_context(**{"reduced_motion": "reduce"} | options)
    context.set_default_timeout(1000 * PATIENCE)
    return context


@contextmanager
def serving(application: ASGIApp, port: int = 0) -> Iterator[str]:
    """Serve an ASGI application on loopback, on a free port unless one is given; gives its http address."""
    import uvicorn

    listener = socket.create_server(("127.0.0.1", port))
    server = uvicorn.Server(uvicorn.Config(application, log_level="warning", lifespan="off", ws="websockets-sansio"))
    thread = threading.Thread(target=server.run, args=([listener],), name="serve the browser", daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join()
        listener.close()
