"""The whole page in a tab: opened, looked at, dragged about.

A test module whose tests put back what they change on the page, though not the scene, imports the fixture `page`, which
loads it only where that was not so, and for others `fresh_page`.
"""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
import torch
from PIL import Image as PillowImage

from support.pages.browser import kept_as_loaded
from support.pages.viewed import Viewed
from support.patience import PATIENCE
from volsplat.bench.page_drag import REFINED

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


def opened(page: Page, url: str) -> Page:
    page.goto(url)
    page.wait_for_function(REFINED)
    return page


@contextmanager
def kept_open(browser: Browser, view: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    """The page with the volume refined to the end, as it is when it was just loaded."""
    test, context = request.node.nodeid, browser.contexts[0]
    with kept_as_loaded(context, view.url, test, lambda tab: opened(tab, view.url)) as kept:
        kept.wait_for_function(REFINED)
        yield kept


@pytest.fixture
def page(browser: Browser, view: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    with kept_open(browser, view, request) as kept:
        yield kept


@pytest.fixture
def fresh_page(view: Viewed, browser_page: Page) -> Page:
    """The page just loaded, with the volume refined to the end."""
    return opened(browser_page, view.url)


def canvas(page: Page) -> torch.Tensor:
    """What is on the canvas, (H, W, 4) uint8."""
    data = page.evaluate(
        "() => window.volsplatViewport.canvas.toDataURL('image/png').slice('data:image/png;base64,'.length)"
    )
    return pixels_of(base64.b64decode(data))


def pixels_of(png: bytes) -> torch.Tensor:
    """Of an image in a file, (H, W, 4) uint8."""
    image = PillowImage.open(io.BytesIO(png)).convert("RGBA")
    return torch.frombuffer(bytearray(image.tobytes()), dtype=torch.uint8).reshape(image.height, image.width, 4)


def after(page: Page, action: Callable[[], object]) -> torch.Tensor:
    """The canvas once the scene that the action makes is refined to the end."""
    return _next_last(page, action, "revision")


def draws_again(page: Page, action: Callable[[], object], image: torch.Tensor) -> None:
    """Do something after which the same scene is drawn anew, perhaps more than once, and wait until that is seen."""
    _next_last(page, action, "number")
    deadline = time.monotonic() + PATIENCE
    while not torch.equal(canvas(page), image):
        assert time.monotonic() < deadline, "the scene is not drawn as before"
        page.wait_for_timeout(50)


def _next_last(page: Page, action: Callable[[], object], rising: str) -> torch.Tensor:
    before = page.evaluate(f"() => window.volsplatViewport.log.at(-1).{rising}")
    action()
    page.wait_for_function(
        f"() => {{ const p = window.volsplatViewport?.log.at(-1); return p?.last && p.{rising} > {before}; }}"
    )
    return canvas(page)


def drag(page: Page, dx: float, dy: float) -> None:
    box = page.locator(".vs-picture").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=8)
    page.mouse.up()


def save(page: Page, item: str) -> bytes:
    page.get_by_role("button", name="save").click()
    with page.expect_download() as download:
        page.get_by_text(item).click()
    return download.value.path().read_bytes()
