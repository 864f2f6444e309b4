"""Distances and angles between points that are seen, in the volume's units, or in words why there are none."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

from support.pages.browser import browser, browser_page, serving
from support.pages.viewport_process import VOLUME, ShownViewport, ViewportProcess

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

EXACT = {"density_is": "", "strength_is": ""}
FIRST, SECOND, THIRD = [10, 10, 10], [13, 14, 10], [13, 14, 16]  # voxels of 1 x 1 x 2 mm


@pytest.fixture
def shown(browser_page: Page) -> Iterator[ShownViewport]:
    process = ViewportProcess()
    with serving(process.application) as url:
        shown = ShownViewport(browser_page, process, url)
        shown.show_and_wait()
        yield shown


def measure(shown: ShownViewport, *points: list[int]) -> None:
    """Click on the picture, where each time this voxel is seen."""
    for n, index in enumerate(points):
        shown.process.forget()
        shown.page.mouse.click(200 + 40 * n, 150)
        found = {"index": index, "density": 5.0, "strength": 6.0}
        shown.process.say({**shown.process.wait_for_probe(), **EXACT, "found": found})
        ends = shown.page.locator(".vs-overlay .vs-measured-lines circle")
        shown.page.wait_for_function(
            "(count) => document.querySelectorAll('.vs-overlay .vs-measured-lines circle').length === count", arg=n + 1
        )
        assert ends.count() == n + 1


def test_two_clicks_measure_a_distance_and_a_third_an_angle(shown: ShownViewport) -> None:
    from playwright.sync_api import expect

    told = shown.page.locator(".vs-measured")
    expect(told).to_be_hidden()
    shown.page.get_by_role("button", name="measure").click()
    expect(told).to_contain_text("click two points")
    measure(shown, FIRST, SECOND)
    expect(told).to_have_text("5 mm")
    assert shown.page.locator(".vs-overlay .vs-measured-lines line").count() == 1
    shown.page.keyboard.press("Escape")
    expect(told).to_be_hidden()
    shown.page.keyboard.press("m")
    measure(shown, FIRST, SECOND, THIRD)
    expect(told).to_have_text("5 mm · 12 mm · 90°")
    assert shown.process.heard_of("center") == []
    shown.page.keyboard.press("m")
    assert shown.page.locator(".vs-overlay .vs-measured-lines circle").count() == 0


def scale(name: str, unit: str, length: float) -> dict[str, Any]:
    return {"name": name, "unit": unit, "length": length, "axis": None}


def axes(*named: tuple[str, str]) -> list[dict[str, Any]]:
    return [{"name": name, "unit": unit, "first": 0.0, "step": 0.5} for name, unit in named]


SKY = axes(("RA", "deg"), ("Dec", "deg"), ("velocity", "km/s"))


@pytest.mark.parametrize(
    ("volume", "words"),
    [
        (
            {"axes": SKY, "scales": [scale("RA, Dec", "deg", 2.0), scale("velocity", "km/s", 4.0)]},
            "2.5 deg · 3 km/s · no angle: RA, Dec (deg) and velocity (km/s) are of different kinds",
        ),
        (
            {"unit": "", "scales": [scale("i, j", "voxels", 1.0), scale("k", "voxels", 2.0)]},
            "5 voxels · 6 voxels · 90°",
        ),
    ],
)
def test_a_volume_of_several_scales_is_measured_along_one_at_a_time(
    shown: ShownViewport, volume: dict[str, Any], words: str
) -> None:
    from playwright.sync_api import expect

    shown.process.say({**VOLUME, **volume})
    shown.page.get_by_role("button", name="measure").click()
    measure(shown, FIRST, SECOND, THIRD)
    expect(shown.page.locator(".vs-measured")).to_have_text(words)
    shown.page.keyboard.press("Escape")
    shown.page.keyboard.press("m")
    measure(shown, FIRST, THIRD)
    expect(shown.page.locator(".vs-measured")).to_contain_text("no distance: ")
