"""What the folded panel of servers says while the volume turns, in a real browser, and what that costs the page."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

from support.pages.browser import browser, browser_page
from support.pages.page_tab import page
from support.pages.tables_tab import box
from volsplat.client.ui.panels.servers.servers_summary import INTERVAL
from volsplat.client.ui.viewing.moving_rate import LEAST

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page", "page"]

AT_REST = re.compile(r"^2 map/shade \+ 1 splat · step F in [0-9.]+ m?s$")
MOVING = re.compile(r"^2 map/shade \+ 1 splat · step [A-F] in [0-9.]+ m?s · ([0-9.]+) images/s$")
SECONDS = 3.0  # that it is turned for
WATCHED = """(line) => {
    window.toldAt = [];
    window.rendered = [];
    new MutationObserver(() => window.toldAt.push(performance.now() / 1000)).observe(line, { childList: true });
    window.socket.onAny((kind, what) => kind === "update" && window.rendered.push(...Object.keys(what)));
}"""


def turn_for(page: Page, seconds: float) -> None:
    """With the button held at the end."""
    place = box(page.locator(".vs-picture"))
    x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    began, moves = time.monotonic(), 0
    while time.monotonic() < began + seconds:
        moves += 1
        page.mouse.move(x + moves % 50, y + moves % 40)
        page.wait_for_timeout(20)


def test_images_a_second_are_told_while_the_volume_turns_and_for_some_seconds_after(page: Page) -> None:
    from playwright.sync_api import expect

    line = page.locator(".vs-servers-head .vs-muted")
    expect(line).to_have_text(AT_REST)
    line.evaluate(WATCHED)
    first = page.evaluate("() => window.volsplatViewport.log.at(-1).number")
    turn_for(page, SECONDS)
    expect(line).to_have_text(MOVING)
    told = MOVING.match(line.inner_text())
    shown = page.evaluate("(first) => window.volsplatViewport.log.filter(p => p.number > first).length", first)
    assert told is not None and shown > LEAST
    assert shown / SECONDS / 2 < float(told[1]) < 200
    page.mouse.up()
    page.wait_for_function("() => window.volsplatViewport.log.at(-1).last")
    expect(line).to_have_text(MOVING)
    expect(line).to_have_text(AT_REST)  # once it is no news any more
    times = page.evaluate("window.toldAt")
    during = [time for time in times if time < times[0] + SECONDS]
    assert 1 < len(during) <= SECONDS / INTERVAL + 1
    name = line.get_attribute("id") or ""
    assert re.fullmatch(r"c\d+", name) and name.removeprefix("c") not in page.evaluate("window.rendered")
