"""What the plots of the tables show beside the points, in a real browser: the data's histogram, and its axis."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from support.pages.tables_page import SCENE, WINDOW
from support.pages.tables_tab import Tab, box, near, until

if TYPE_CHECKING:
    from playwright.sync_api import Locator

SOFT_TISSUE = (48 - WINDOW[0]) / (WINDOW[1] - WINDOW[0])  # the table position of a peak of the histogram
BULK = 1000  # voxels, in most bars


def test_the_histogram_can_be_linear(tab: Tab) -> None:
    histogram = tab.table("opac").locator('[data-part="histogram"]')
    logarithmic = histogram.get_attribute("d")
    tab.page.get_by_label("Opacity: logarithmic histogram").click()
    assert histogram.get_attribute("d") not in (logarithmic, "")
    assert tab.scene == SCENE


@pytest.mark.parametrize(
    ("counts", "heights"),
    [
        ([0] * 256, {0: 0.0}),
        ([7] * 256, {0: 1.0, 255: 1.0}),
        ([0, 5, 0, 100_000], {0: 0.0, 3: 1.0}),
        ([*range(BULK, BULK + 250), 3, 1_000_000], {251: 1.0}),
    ],
)
def test_the_logarithmic_bars_show_all_that_is_there(tab: Tab, counts: list[int], heights: dict[int, float]) -> None:
    bars: list[float] = tab.page.evaluate(
        "async (counts) => (await import('/volsplat/static/tables/table_numbers.js')).barHeights(counts, true)", counts
    )
    for n, height in heights.items():
        assert bars[n] == pytest.approx(height)
    assert all((count > 0) == (0 < bar <= 1) for count, bar in zip(counts, bars, strict=True))
    assert sorted(range(len(counts)), key=lambda n: counts[n]) == sorted(range(len(counts)), key=lambda n: bars[n])


def test_the_bulk_of_a_histogram_is_low_beside_its_peak(tab: Tab) -> None:
    bars: list[float] = tab.page.evaluate(
        "async (counts) => (await import('/volsplat/static/tables/table_numbers.js')).barHeights(counts, true)",
        [3, *range(BULK, BULK + 250), 1_000_000],
    )
    assert max(bars[1:-1]) < 0.2


def test_the_bars_under_the_opacity_take_the_reflected_colours(tab: Tab) -> None:
    assert colour_in(tab, "emit") == pytest.approx(colour_in(tab, "refl"), abs=3)
    tab.points("refl").first.focus()
    tab.types("refl", "value", "#ff0000")
    until(tab.page, lambda: is_red(colour_in(tab, "opac")))
    assert not is_red(colour_in(tab, "refl"))
    tab.choose("refl", "From a preset", "molecules")
    until(tab.page, lambda: not is_red(colour_in(tab, "opac")))


def colour_in(tab: Tab, which: str) -> tuple[int, int, int]:
    """Of a bar of the histogram, near its foot."""
    picture = Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB")
    x, y = tab.place(which, SOFT_TISSUE + 0.02, 0.12)
    colour = picture.getpixel((round(x), round(y)))
    assert isinstance(colour, tuple)
    r, g, b = colour
    return (r, g, b)


def is_red(colour: tuple[int, int, int]) -> bool:
    return colour[0] > 2 * max(colour[1:])


def test_both_ends_of_the_window_stand_under_the_plots(tab: Tab) -> None:
    assert ends(tab, "opac") == ["−1000", "1550"]
    texts = tab.table("opac").locator('[data-part="axis"] text')
    assert len(texts.all()) > 3
    boxes = sorted((box(text) for text in texts.all()), key=lambda place: place["x"])
    for left, right in zip(boxes[:-1], boxes[1:], strict=True):
        assert left["x"] + left["width"] < right["x"]


def ends(tab: Tab, which: str) -> list[str]:
    found: Locator = tab.table(which).locator("[data-end]")
    return found.all_text_contents()


# -- a short panel


@pytest.fixture
def short(tab: Tab) -> Iterator[Tab]:
    """The panel as high as an open panel of servers leaves it in a window of 1280x800."""
    window = tab.page.viewport_size
    assert window is not None
    tab.page.set_viewport_size({"width": 1280, "height": 566})
    until(tab.page, lambda: bottom(tab.table("modu").locator('[data-part="axis"]')) <= 566)
    yield tab
    tab.page.set_viewport_size(window)


def bottom(locator: Locator) -> float:
    place = box(locator)
    return place["y"] + place["height"]


def curve_height(tab: Tab, which: str) -> float:
    return tab.place(which, 0, 0)[1] - tab.place(which, 0, 1)[1]


def test_a_short_panel_shows_all_four_curves_at_a_fair_height(short: Tab) -> None:
    for which, least in (("emit", 50), ("refl", 50), ("opac", 40), ("modu", 40)):
        assert curve_height(short, which) >= least
    assert bottom(short.table("modu").locator('[data-part="axis"]')) <= 566
    panel = short.page.locator(".vs-right")
    assert panel.evaluate("(panel) => panel.scrollHeight === panel.clientHeight")


def test_the_fields_of_a_point_move_nothing_in_a_short_panel(short: Tab) -> None:
    plot = short.table("opac").locator(".vs-table-plot")
    before = box(plot)
    short.page.mouse.click(*short.place("opac", 0.4, 0.5))
    short.types("opac", "value", "0.25")
    short.waits_for(lambda scene: scene.tables.opac.points[1][1] == 0.25)
    assert box(plot) == before
    short.drag(short.place("opac", 0.2, 0.0), short.place("opac", 0.3, 0.6))  # from under the fields' edge
    short.waits_for(lambda scene: scene.tables.opac.points[0][1] == near(0.6))


def test_what_is_wrong_is_told_in_a_short_panel(short: Tab) -> None:
    short.points("opac").first.focus()
    short.types("opac", "value", "7")
    alert = short.table("opac").get_by_role("alert")
    assert alert.is_visible() and "not a number from 0 to 1" in alert.inner_text()
    assert box(alert)["y"] > box(short.table("opac"))["y"]
