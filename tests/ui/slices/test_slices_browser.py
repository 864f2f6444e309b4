"""Three slices beside the picture, on the real page: seen, moved through, linked with one another and the picture."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from support.files.opened import read_whole
from support.pages.browser import browser, browser_page, kept_as_loaded, patient_context
from support.pages.fingers import SAFARI_PINCH, fingers_on, pinch
from support.pages.page_tab import after, drag, opened
from support.pages.tables_tab import box, until
from support.pages.viewed import Viewed

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

__all__ = ["browser", "browser_page"]

PIXELS = """(slice) => {
    const canvas = slice.querySelector("canvas");
    return Array.from(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data).join();
}"""


WHEEL = """(slice, [unit, deltaY, ctrlKey]) => {
    const deltaMode = WheelEvent[`DOM_DELTA_${unit}`], { x, y, width, height } = slice.getBoundingClientRect();
    const wheel = { deltaMode, deltaY, ctrlKey, clientX: x + width / 2, clientY: y + height / 2, cancelable: true };
    return !slice.dispatchEvent(new WheelEvent("wheel", { ...wheel, bubbles: true }));
}"""

BEGIN = {"i": 11, "j": 15, "k": 13}


@pytest.fixture
def page(browser: Browser, view: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    """With slices as they are when the page was just loaded; they are put back, and the page kept if they are so."""
    test, context = request.node.nodeid, browser.contexts[0]
    with kept_as_loaded(context, view.url, test, lambda tab: with_slices(tab, view.url)) as page:
        yield page
        for name, index in BEGIN.items():
            slice_across(page, name).focus()
            for key in ("0", "Home", "PageUp", *["ArrowUp"] * (index - 10)):
                page.keyboard.press(key)


@pytest.fixture
def fresh_page(view: Viewed, browser_page: Page) -> Page:
    return with_slices(browser_page, view.url)


def with_slices(page: Page, url: str) -> Page:
    opened(page, url)
    page.get_by_role("button", name="three slices").click()
    for name in "ijk":
        shown(page, name)
    return page


def slice_across(page: Page, name: str) -> Locator:
    return page.get_by_role("slider", name=f"slice across {name}")


def index_of(page: Page, name: str) -> int:
    return int(slice_across(page, name).get_attribute("aria-valuenow") or "-1")


def shown(page: Page, name: str) -> str:
    """The pixels of a slice once the one is there that it is to show."""
    across = slice_across(page, name)
    until(page, lambda: across.get_attribute("data-shown") == across.get_attribute("aria-valuenow"))
    return str(across.evaluate(PIXELS))


def test_a_click_in_one_slice_moves_the_others_and_the_mark_in_the_picture(page: Page) -> None:
    mark = page.locator(".vs-point")
    before, marked = {name: index_of(page, name) for name in "ijk"}, mark.get_attribute("transform")
    place = box(slice_across(page, "k"))
    page.mouse.click(place["x"] + 0.35 * place["width"], place["y"] + 0.6 * place["height"])
    assert index_of(page, "k") == before["k"]
    assert index_of(page, "i") != before["i"] and index_of(page, "j") != before["j"]
    assert mark.get_attribute("transform") != marked
    for name in "ij":
        shown(page, name)


def test_a_slice_is_zoomed_about_the_pointer_moved_and_reset_and_the_cross_hair_stays_right(page: Page) -> None:
    across, place = slice_across(page, "k"), box(slice_across(page, "k"))
    x, y = place["x"] + 0.4 * place["width"], place["y"] + 0.6 * place["height"]
    page.mouse.click(x, y)
    through, whole = {name: index_of(page, name) for name in "ij"}, shown(page, "k")
    sent = page.evaluate("() => window.volsplatViewport.sent.length")
    page.keyboard.down("Control")
    page.mouse.wheel(0, -800)
    page.keyboard.up("Control")
    until(page, lambda: across.get_attribute("data-zoom") == "4.000")
    assert shown(page, "k") != whole
    crossing = across.locator(".vs-slice-cross line").evaluate_all(
        "lines => lines.map(l => [l.x1.baseVal.value, l.y1.baseVal.value])"
    )
    on_line = [abs(end[n] - at) for end in crossing for n, at in ((0, x - place["x"]), (1, y - place["y"]))]
    voxel = 4 * place["width"] / 24
    assert sorted(on_line)[1] <= voxel / 2 + 1, "the cross-hair is where the pointer is, to half a voxel"
    page.mouse.click(x, y)
    assert {name: index_of(page, name) for name in "ij"} == through, "the same voxel is under the pointer"
    page.mouse.down(button="middle")
    page.mouse.move(x + voxel, y, steps=3)
    page.mouse.up(button="middle")
    page.mouse.click(x + voxel, y)
    moved = {name: index_of(page, name) for name in "ij"}
    assert all(abs(moved[name] - through[name]) <= 1 for name in "ij"), "it came along"
    page.mouse.dblclick(x, y)
    until(page, lambda: across.get_attribute("data-zoom") == "1.000")
    across.focus()
    page.keyboard.press("+")
    assert across.get_attribute("data-zoom") == "1.250"
    page.keyboard.press("0")
    assert across.get_attribute("data-zoom") == "1.000"
    assert page.evaluate("() => window.volsplatViewport.sent.length") == sent, "the picture's view is left alone"


def test_one_finger_moves_the_other_slices_and_two_zoom_and_move_what_lies_between_them(
    browser: Browser, view: Viewed
) -> None:
    with patient_context(browser, has_touch=True) as context:
        page = with_slices(context.new_page(), view.url)
        across, touch, sent = slice_across(page, "k"), fingers_on(page), "() => window.volsplatViewport.sent.length"
        place, said = box(across), page.evaluate(sent)
        x, y = round(place["x"] + 0.4 * place["width"]), round(place["y"] + 0.6 * place["height"])

        def tapped(at_x: float, at_y: float) -> list[int]:
            touch("touchStart", (at_x, at_y))
            touch("touchEnd")
            return [index_of(page, name) for name in "ijk"]

        middle = [index_of(page, name) for name in "ijk"]
        there = tapped(x, y)
        assert there[0] != middle[0] and there[1] != middle[1] and there[2] == middle[2]
        pinch(touch, ((x - 10, y), (x + 10, y)), ((x - 20, y), (x + 20, y)), ((x - 10, y + 9), (x + 50, y + 9)))
        assert across.get_attribute("data-zoom") == "3.000"
        assert [index_of(page, name) for name in "ijk"] == there, "the first of two fingers moves nothing"
        assert tapped(x + 20, y + 9) == there, "what lay between the fingers came along"
        for name in "ijk":
            shown(page, name)

        touch("touchStart", (x, y))
        touch("touchStart", (x, y), (x + 40, y))
        touch("touchEnd", (x + 40, y), first=1)
        touch("touchMove", (x - 80, y))
        touch("touchEnd")
        assert across.get_attribute("data-zoom") == "3.000"
        assert tapped(x - 60, y + 9) == there, "one finger that is left moves what is enlarged"
        assert page.evaluate(sent) == said, "the picture's view is left alone"


def test_fingers_measure_on_a_slice_where_they_tap_but_not_where_they_pinch(browser: Browser, view: Viewed) -> None:
    with patient_context(browser, has_touch=True) as context:
        page = with_slices(context.new_page(), view.url)
        across, touch = slice_across(page, "k"), fingers_on(page)
        place, points = box(across), across.locator(".vs-measured-lines circle")
        x, y = round(place["x"] + place["width"] / 2), round(place["y"] + place["height"] / 2)
        page.keyboard.press("m")
        pinch(touch, ((x - 10, y), (x + 10, y)), ((x - 15, y), (x + 15, y)))
        assert points.count() == 0 and across.get_attribute("data-zoom") == "1.500"
        touch("touchStart", (x, y))
        touch("touchEnd")
        until(page, lambda: points.count() == 1)


def test_wheel_and_keys_step_a_slice_and_leave_the_view_alone(page: Page) -> None:
    sent = page.evaluate("() => window.volsplatViewport.sent.length")
    across, begin = slice_across(page, "k"), index_of(page, "k")
    pixels = shown(page, "k")
    across.hover()
    page.mouse.wheel(0, -120)  # a notch
    until(page, lambda: index_of(page, "k") == begin + 1)
    for _ in range(4):  # as of a touchpad
        page.mouse.wheel(0, -13)
    until(page, lambda: index_of(page, "k") == begin + 2)
    assert shown(page, "k") != pixels
    across.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowLeft")
    assert index_of(page, "k") == begin and shown(page, "k") == pixels
    page.keyboard.press("End")
    assert index_of(page, "k") == 27
    page.keyboard.press("PageDown")
    assert index_of(page, "k") == 17 and page.evaluate("() => window.volsplatViewport.sent.length") == sent


@pytest.mark.parametrize("unit", ["LINE", "PAGE"])
def test_a_wheel_that_counts_in_lines_or_pages_steps_a_slice_a_notch_and_zooms_as_far_as_they_are(
    page: Page, unit: str
) -> None:
    across, begin = slice_across(page, "k"), index_of(page, "k")
    count, height = (-3, 33.0) if unit == "LINE" else (-1, box(across)["height"])
    assert across.evaluate(WHEEL, [unit, count, False]) and index_of(page, "k") == begin + 1
    across.evaluate(WHEEL, [unit, count, True])
    zoom = float(across.get_attribute("data-zoom") or "nan")
    assert zoom == pytest.approx(2 ** (-count * height / 400), abs=2e-3)


def test_a_trackpads_pinch_zooms_a_slice_in_safari(page: Page) -> None:
    across = slice_across(page, "k")
    across.evaluate(SAFARI_PINCH, [1.5, 3.0])
    assert across.get_attribute("data-zoom") == "3.000"


def test_a_pointer_on_a_slice_is_told_the_files_own_value_and_shift_pointing_at_the_picture_moves_all(
    page: Page, volume: Path
) -> None:
    place = box(slice_across(page, "k"))
    page.mouse.move(place["x"] + place["width"] / 2, place["y"] + place["height"] / 2)
    value = page.locator(".vs-value")
    value.wait_for()
    until(page, lambda: re.match(r"value -?[0-9.e-]+ ", value.inner_text()) is not None)  # and not ≈
    i, j, k = map(int, re.findall("[0-9]+", value.inner_text().rpartition(" at ")[2]))
    own = read_whole(volume)[k, j, i]
    assert k == index_of(page, "k") and own.dtype.type(value.inner_text().split()[1]) == own
    picture = box(page.locator(".vs-picture"))
    page.keyboard.down("Shift")
    page.mouse.move(picture["x"] + picture["width"] / 2, picture["y"] + picture["height"] / 2 + 4)
    page.mouse.move(picture["x"] + picture["width"] / 2, picture["y"] + picture["height"] / 2)
    page.keyboard.up("Shift")

    def goes_through_it() -> bool:
        through = ", ".join(str(index_of(page, name)) for name in "ijk")
        return value.is_visible() and value.inner_text().endswith(f"({through})")

    until(page, goes_through_it)


def test_slices_follow_tables_and_bounds_but_not_the_turning_hand(page: Page) -> None:
    pixels = shown(page, "k")
    page.keyboard.press("g")
    until(page, lambda: shown(page, "k") != pixels)
    page.keyboard.press("g")
    until(page, lambda: shown(page, "k") == pixels)
    after(page, lambda: drag(page, 40, 10))
    assert shown(page, "k") == pixels
    outline = slice_across(page, "k").locator(".vs-slice-bounds")
    before = outline.get_attribute("points")
    page.get_by_label("lowest i", exact=True).fill("8")
    page.keyboard.press("Enter")
    until(page, lambda: outline.get_attribute("points") != before)
    page.get_by_label("lowest i", exact=True).fill("0")
    page.keyboard.press("Enter")
    until(page, lambda: outline.get_attribute("points") == before)
    page.get_by_role("button", name="5–95 %").click()
    until(page, lambda: shown(page, "k") != pixels)
    page.get_by_role("button", name="automatic").click()
    until(page, lambda: shown(page, "k") == pixels)


def test_slices_are_there_again_after_loading_anew_and_in_a_small_window(fresh_page: Page) -> None:
    page = fresh_page
    page.set_viewport_size({"width": 390, "height": 844})
    page.reload()
    places = []
    for name in "ijk":
        shown(page, name)
        places.append(box(slice_across(page, name)))
    assert min(place["width"] for place in places) > 150 and min(place["height"] for place in places) > 150
    page.keyboard.press("s")
    slice_across(page, "k").wait_for(state="detached")
    assert box(page.locator(".vs-picture"))["width"] == 390


def test_on_slices_distances_are_measured_by_hand_and_by_keys(page: Page) -> None:
    from playwright.sync_api import expect

    page.keyboard.press("m")
    told, across = page.locator(".vs-measured"), slice_across(page, "k")
    across.focus()
    page.keyboard.press("Enter")
    for _ in range(3):
        page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    length = page.evaluate("() => Math.hypot(...window.volsplatViewport.grid.toUpright.map((row) => row[2])) * 3")
    expect(told).to_have_text(f"{length:.4g} mm")
    before, place = index_of(page, "i"), box(across)
    page.mouse.click(place["x"] + 0.4 * place["width"], place["y"] + place["height"] / 2)
    expect(told).to_contain_text("°")
    assert index_of(page, "i") == before
    assert across.locator(".vs-measured-lines circle").count() == 3
    page.keyboard.press("m")
