"""A real browser for tests of the page: Debian's Chromium, driven by Playwright, and a server for what it loads.

A test module imports the fixtures that it wants by name, `browser` among them since `browser_page` needs it, and says
`__all__ = ["browser", "browser_page"]`, which tells ruff that they are used.
"""

from __future__ import annotations

import shutil
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest

from support.patience import PATIENCE

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page, Request
    from starlette.types import ASGIApp

_POLICY = "Content Security Policy"
# Code that runs a few times is not worth what it costs to compile it well.
_ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--js-flags=--no-opt --no-maglev")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Headless Chromium, started once for a module of tests. Debian's shell of it does a page for half the work.

    Its first context is that of `browser_page`, for all tests: what they all load is loaded and compiled once.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright (extra dev)")
    executable = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if executable is None:
        pytest.skip("the browser tests need Chromium: apt install chromium-headless-shell, or chromium")
    playwright.expect.set_options(timeout=1000 * PATIENCE)
    with playwright.sync_playwright() as running:
        launched = running.chromium.launch(executable_path=executable, args=_ARGUMENTS)
        with patient_context(launched, viewport={"width": 1280, "height": 800}):
            yield launched
        launched.close()


@pytest.fixture
def browser_page(browser: Browser) -> Iterator[Page]:
    """An empty tab of 1280x800, of a browser that remembers nothing of the tests before but files that may be kept.

    The test fails if a script of the page fails, or breaks the page's own policy.
    """
    failures: list[str] = []
    origins: set[str] = set()

    def note_origin(request: Request) -> None:
        if request.is_navigation_request():
            origins.add("{0.scheme}://{0.netloc}".format(urlsplit(request.url)))

    context = browser.contexts[0]
    context.on("request", note_origin)
    page = context.new_page()
    page.on("pageerror", lambda error: failures.append(f"{error.message}\n{error.stack}"))
    page.on("console", lambda told: failures.append(told.text) if _POLICY in told.text else None)
    yield page
    context.remove_listener("request", note_origin)
    _forget(context, origins)
    assert not failures, "a script of the page failed:\n" + "\n".join(failures)


def _forget(context: BrowserContext, origins: Iterable[str]) -> None:
    """Close its tabs, and have it as it was when it began."""
    storage = context.new_cdp_session(context.pages[0] if context.pages else context.new_page())
    for origin in origins:
        storage.send("Storage.clearDataForOrigin", {"origin": origin, "storageTypes": "local_storage"})
    for page in context.pages:
        close_tab(page)
    context.clear_cookies()
    context.clear_permissions()


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
    """Tabs as of a browser started anew, which wait as tests do, and move nothing by themselves unless asked to.

    Each frame of an animation takes as much as a test's click.
    """
    with browser.new_context(**{"reduced_motion": "reduce"} | options) as context:
        context.set_default_timeout(1000 * PATIENCE)
        yield context


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
