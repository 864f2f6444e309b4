"""The whole page in a tab: opened, looked at, dragged about."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from PIL import Image as PillowImage

from support.patience import PATIENCE
from volsplat.bench.page_drag import REFINED

if TYPE_CHECKING:
    from playwright.sync_api import Page


def opened(page: Page, url: str) -> Page:
    page.goto(url)
    page.wait_for_function(REFINED)
    return page


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
        f"() => {{ const p = window.volsplatViewport.log.at(-1); return p.last && p.{rising} > {before}; }}"
    )
    return canvas(page)


def drag(page: Page, dx: float, dy: float) -> None:
    box = page.locator(".vs-view canvas").first.bounding_box()
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
