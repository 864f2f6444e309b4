"""The wheel of phases on the page, in a real browser: there while the scene colours by phase, and only then."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from support.pages.browser import browser, browser_page
from support.pages.viewed import Viewed, viewed
from volsplat.client.phantoms import streamed_phantom
from volsplat.client.phantoms.volume_writer import write_phantom

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewed]:
    path: Path = tmp_path_factory.mktemp("volume") / "factors.nrrd"
    write_phantom(path, streamed_phantom("structure-factors", (16, 16, 16)))
    with viewed(path.parent, path, "--workers", "1") as running:
        yield running


def test_the_wheel_is_there_while_the_scene_colours_by_phase(view: Viewed, browser_page: Page) -> None:
    page = browser_page
    page.goto(view.url)
    legend = page.get_by_role("img", name="colours of phase")
    legend.wait_for()
    assert legend.text_content() == "0°90°180°270°"
    wheel = page.locator(".vs-phase-wheel")
    picture = Image.open(io.BytesIO(wheel.screenshot(animations="disabled"))).convert("RGB")
    red, green, blue = pixel(picture, 0.85, 0.45)  # just above the right: the first sector of phase
    assert red > 1.5 * max(green, blue)
    red, green, blue = pixel(picture, 0.15, 0.55)  # just below the left: past 180 degrees
    assert red < min(green, blue)

    page.get_by_text("Presets", exact=True).click()
    page.locator(".vs-preset", has_text="depth-cue").click()
    legend.wait_for(state="hidden")
    page.get_by_label("undo").click()
    legend.wait_for()


def pixel(picture: Image.Image, x: float, y: float) -> tuple[int, int, int]:
    colour = picture.getpixel((round(x * picture.width), round(y * picture.height)))
    assert isinstance(colour, tuple)
    r, g, b = colour
    return r, g, b
