"""What the page says and does while a line, or the process, stands still for long, on a clock that the test moves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import psutil
import pytest

from support.pages.browser import browser, no_failures, patient_context
from support.pages.page_tab import drag, opened
from support.pages.tables_tab import until
from support.pages.viewed import Viewed
from volsplat.bench.page_drag import REFINED

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Request

__all__ = ["browser"]

NO_ANSWER, NO_CONNECTION = "does not answer", "No connection"
SECOND = 1000
ALIVE = re.compile("/alive")
ROTATION = "() => window.volsplatViewport.view.rotation"
SHOWS = (
    "(rotation) => window.volsplatViewport.log.at(-1).view.rotation.every((w, n) => Math.abs(w - rotation[n]) < 1e-6)"
)
CONNECTED = "() => window.newest.readyState === WebSocket.OPEN"
# Playwright's clock has no part in the time that fetch() may take.
OF_THE_CLOCK = """
    AbortSignal.timeout = (milliseconds) => {
        const ended = new AbortController();
        setTimeout(() => ended.abort(new DOMException("", "TimeoutError")), milliseconds);
        return ended.signal;
    };
    window.sockets = 0;
    window.WebSocket = class extends WebSocket {
        constructor(url, ...rest) {
            super(url, ...rest);
            if (!String(url).includes("/viewport?")) return;
            window.sockets += 1;
            window.newest = this;
        }
    };
"""
WATCH_POPUP = """() => {
    const popup = document.getElementById("popup");
    window.popupSeen = false;
    window.popupWanted = false;
    new MutationObserver(() => {
        window.popupWanted ||= popup.ariaHidden === "false";
        window.popupSeen ||= popup.checkVisibility();
    }).observe(document.body, { attributes: true, childList: true, subtree: true });
}"""


@pytest.fixture
def page(browser: Browser, view: Viewed) -> Iterator[Page]:
    """A page whose time the test moves on."""
    with patient_context(browser, viewport={"width": 1280, "height": 800}) as context:
        page = context.new_page()
        page.clock.install()
        page.add_init_script(OF_THE_CLOCK)
        with no_failures(page):
            opened(page, view.url).evaluate(WATCH_POPUP)
            yield page


@contextmanager
def by_hand(page: Page) -> Iterator[None]:
    """The page's clock stands but for what the test moves it on by."""
    page.clock.pause_at(page.evaluate("Date.now()") / 1000 + 0.1)
    yield
    page.clock.resume()


@contextmanager
def standing_still(view: Viewed, page: Page) -> Iterator[None]:
    frozen = psutil.Process(view.process.pid)
    with by_hand(page):
        frozen.suspend()
        try:
            yield
        finally:
            frozen.resume()


def told_after(page: Page, words: str) -> float:
    """The seconds that pass on the page's clock until the viewport says this."""
    status, steps = page.locator(".vs-trouble"), 0
    while words not in status.inner_text():
        assert steps < 200, f"never told: {words}"
        steps += 1
        page.clock.run_for(SECOND // 2)
        page.wait_for_timeout(50)  # for what the clock has no part in
    return steps / 2


def made(page: Page) -> int:
    """The connections that the viewport has tried since the page was loaded."""
    tried: int = page.evaluate("window.sockets")
    return tried


def turned(page: Page, dx: float, dy: float) -> Any:
    """The rotation after a drag."""
    before = page.evaluate(ROTATION)
    drag(page, dx, dy)
    until(page, lambda: page.evaluate(ROTATION) != before)
    return page.evaluate(ROTATION)


def test_a_process_that_stands_still_for_long_is_told_and_what_the_hand_did_meanwhile_is_drawn(
    view: Viewed, page: Page
) -> None:
    from playwright.sync_api import expect

    status, sockets, switch = page.locator(".vs-trouble"), made(page), page.get_by_role("switch", name="diffuse")
    with standing_still(view, page):
        assert 5 <= told_after(page, NO_ANSWER) < 10
        first = turned(page, 50, 10)
        assert 10 <= told_after(page, NO_CONNECTION) < 25
        kept = turned(page, 30, -20)
        assert kept != first
        checked = switch.is_checked()
        switch.click()
        page.clock.run_for(20 * SECOND)
        expect(status).to_contain_text(NO_CONNECTION)
        assert made(page) == sockets, "it is connected anew while nobody answers"
    expect(status).to_be_hidden()
    assert made(page) == sockets + 1
    page.wait_for_function(SHOWS, arg=kept)
    page.wait_for_function(REFINED)
    assert page.evaluate("[window.popupWanted, window.popupSeen]") == [True, False]
    opened(page, view.url)
    expect(switch).to_be_checked(checked=not checked)
    assert page.evaluate(ROTATION) == pytest.approx(kept)


def test_a_process_that_soon_goes_on_is_heard_by_the_same_connection(view: Viewed, page: Page) -> None:
    from playwright.sync_api import expect

    status, sockets = page.locator(".vs-trouble"), made(page)
    with standing_still(view, page):
        told_after(page, NO_ANSWER)
        page.clock.run_for(10 * SECOND)
        expect(status).to_contain_text(NO_ANSWER)
        kept = turned(page, 50, 10)
    expect(status).to_be_hidden()
    page.wait_for_function(SHOWS, arg=kept)
    assert made(page) == sockets
    assert not page.evaluate("window.popupSeen")


def test_a_line_that_takes_no_question_is_told_after_the_second_and_found_again(page: Page) -> None:
    from playwright.sync_api import expect

    status, sockets = page.locator(".vs-trouble"), made(page)
    asked: list[Request] = []
    page.on("requestfailed", lambda request: asked.append(request))
    page.route(ALIVE, lambda route: route.abort())
    with by_hand(page):
        told_after(page, NO_CONNECTION)
        assert 2 <= len(asked) <= 4
        kept = turned(page, 50, 10)
        page.unroute(ALIVE)
    expect(status).to_be_hidden()
    page.wait_for_function(SHOWS, arg=kept)
    assert made(page) == sockets + 1


def test_a_machine_that_slept_has_the_page_connect_anew_without_a_word(page: Page) -> None:
    from playwright.sync_api import expect

    status, sockets = page.locator(".vs-trouble"), made(page)
    page.evaluate(
        "() => new MutationObserver(() => { window.told = true; })"
        ".observe(document.querySelector('.vs-trouble'), { childList: true })"
    )
    with by_hand(page):  # so that no word is due however long it takes to connect
        page.clock.fast_forward(12 * SECOND)
        assert made(page) == sockets
        page.clock.fast_forward(3600 * SECOND)
        assert made(page) == sockets + 1
        page.wait_for_function(CONNECTED)
    kept = turned(page, 50, 10)
    page.wait_for_function(SHOWS, arg=kept)
    expect(status).to_be_hidden()
    assert not page.evaluate("window.told") and not page.evaluate("window.popupSeen")
