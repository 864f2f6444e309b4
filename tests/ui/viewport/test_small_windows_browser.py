"""The page in small windows and under fingers: the picture is there, and the panels are drawers over it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from support.pages.browser import browser, kept_as_loaded, patient_context
from support.pages.fingers import fingers_on, pinch
from support.pages.page_tab import after, opened
from support.pages.tables_tab import box, until
from support.pages.viewed import Viewed
from volsplat.bench.page_drag import REFINED

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Locator, Page, ViewportSize

__all__ = ["browser"]

TELEPHONE, TABLET = (390, 844), (800, 600)
LEAST_LEGIBLE = 8.0  # CSS pixels of letters that are read
# Words whose box lies over another one's or beyond its picture, and words too small to read.
CLASHES = """(least) => {
    const viewport = document.querySelector(".vs-viewport"), bar = document.querySelector(".vs-colours");
    const box = (part) => part.getBoundingClientRect();
    const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    const within = (a, b) => a.left >= b.left && a.right <= b.right && a.top >= b.top && a.bottom <= b.bottom;
    const found = [];
    for (const scale of document.querySelectorAll(".vs-scale")) {
        if (meet(box(scale), box(document.querySelector(".vs-cube")))) found.push("scale and cube");
        for (const part of scale.children) if (!within(box(part), box(scale))) found.push("scale cut off");
    }
    for (const slice of document.querySelectorAll(".vs-slice")) {
        const title = box(slice.querySelector(".vs-slice-title"));
        if (!within(title, box(slice))) found.push("title cut off");
        for (const letter of slice.querySelectorAll(".vs-slice-overlay text"))
            if (meet(title, box(letter))) found.push(`title and ${letter.textContent}`);
    }
    for (const button of viewport.querySelectorAll(".vs-picture-buttons button"))
        if (!within(box(button), box(viewport))) found.push("button cut off");
    if (!within(box(bar), box(viewport))) found.push("bar cut off");
    for (const word of bar.querySelectorAll("text")) {
        if (!within(box(word), box(bar))) found.push(`${word.textContent} cut off`);
        const size = word.getScreenCTM().a * parseFloat(getComputedStyle(word).fontSize);
        if (size < least) found.push(`small ${word.textContent}`);
    }
    return found;
}"""

# Whether a dialog's sides are in the window, and those of all that is seen in it are in the dialog.
SIDES_OF_DIALOG = """() => {
    const sides = (part) => part.getBoundingClientRect();
    const dialog = document.querySelector(".vs-dialog"), { left, right } = sides(dialog);
    const seen = [...dialog.querySelectorAll("*")].filter((part) => part.checkVisibility()).map(sides);
    return [left >= 0 && right <= innerWidth, seen.every((part) => part.left >= left && part.right <= right)];
}"""


@pytest.fixture(scope="module")
def handheld(browser: Browser) -> Iterator[BrowserContext]:
    with patient_context(browser, has_touch=True, is_mobile=True, reduced_motion="no-preference") as context:
        yield context


@pytest.fixture
def page(handheld: BrowserContext, view: Viewed, request: pytest.FixtureRequest) -> Iterator[Page]:
    """The page on a telephone, as it is when it was just loaded, with the picture refined to the end."""

    def load(page: Page) -> None:
        page.set_viewport_size(window_of(TELEPHONE))
        opened(page, view.url)

    with kept_as_loaded(handheld, view.url, request.node.nodeid, load) as page:
        page.wait_for_function(REFINED)
        yield page
        page.set_viewport_size(window_of(TELEPHONE))


def window_of(size: tuple[int, int]) -> ViewportSize:
    width, height = size
    return {"width": width, "height": height}


def height_seen(page: Page) -> float:
    """Of the picture: what is between the page's head and whatever lies over it in the window's middle."""
    return float(
        page.evaluate(
            """() => {
                const canvas = window.volsplatViewport.canvas, box = canvas.getBoundingClientRect();
                const x = box.x + box.width / 2, viewport = window.volsplatViewport.element;
                const over = (y) => viewport.contains(document.elementFromPoint(x, y));
                let y = box.top + 1;
                while (y < box.bottom && over(y)) y += 1;
                return y - box.top;
            }"""
        )
    )


def panels(page: Page) -> tuple[Locator, Locator]:
    return page.locator(".vs-left"), page.locator(".vs-right")


@pytest.mark.parametrize("width", [360, 390, 599, 600, 899])
def test_the_head_of_a_small_window_has_two_lines_and_nothing_in_it_is_cut_off(page: Page, width: int) -> None:
    page.set_viewport_size(window_of((width, 700)))
    page.wait_for_function(REFINED)
    boxes = page.evaluate(
        """() => [...document.querySelectorAll(".vs-head > *, .vs-drawer-button, .vs-step, .vs-order > *")]
            .map((part) => part.getBoundingClientRect()).filter((box) => box.width > 0 && box.height > 0)
            .map((box) => [box.left, box.right, box.top, box.bottom])"""
    )
    lines: list[tuple[float, float]] = []  # what parts beside each other reach from and to
    for _, _, top, bottom in sorted(boxes, key=lambda box: box[2]):
        if lines and top < lines[-1][1] - 1:
            lines[-1] = (lines[-1][0], max(bottom, lines[-1][1]))
        else:
            lines.append((top, bottom))
    assert len(lines) == 2, boxes
    assert all(0 <= left and right <= width for left, right, *_ in boxes)
    assert page.evaluate("() => document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("width", [900, 1000, 1100])
def test_the_head_of_a_window_just_wide_enough_for_panels_is_one_line_with_the_name(page: Page, width: int) -> None:
    page.set_viewport_size(window_of((width, 700)))
    name, save = page.locator(".vs-name").first, page.get_by_role("button", name="save")
    assert name.evaluate("(name) => name.clientWidth >= name.scrollWidth && name.clientWidth > 0")
    assert save.evaluate("(save) => save.clientHeight < 2 * parseFloat(getComputedStyle(save).lineHeight)")
    assert page.evaluate("() => document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("size", [TELEPHONE, TABLET], ids=["telephone", "tablet"])
def test_the_picture_fills_a_small_window_and_each_panel_is_a_drawer(page: Page, size: tuple[int, int]) -> None:
    from playwright.sync_api import expect

    page.set_viewport_size(window_of(size))
    page.wait_for_function(REFINED)
    box = page.locator(".vs-picture").bounding_box()
    assert box is not None
    assert box["width"] == size[0] and box["height"] > 0.7 * size[1]
    assert page.evaluate("() => document.documentElement.scrollWidth") == size[0]
    scene, tables = panels(page)
    expect(scene).to_be_hidden()
    expect(tables).to_be_hidden()
    for name, shown, other in (("scene", scene, tables), ("tables", tables, scene)):
        button = page.get_by_role("button", name=name, exact=True)
        button.tap()
        expect(button).to_have_attribute("aria-expanded", "true")
        expect(shown).to_be_visible()
        expect(other).to_be_hidden()
        inside = shown.bounding_box()
        assert inside is not None
        assert inside["x"] >= 0 and inside["x"] + inside["width"] <= size[0]
        assert inside["y"] + inside["height"] <= size[1]
        # What a panel changes is seen while it is open: beside it, or above it.
        assert size == TABLET or height_seen(page) > 0.3 * size[1]
        assert size == TELEPHONE or inside["width"] < 0.5 * size[0]
    button = page.get_by_role("button", name="scene", exact=True)
    button.tap()
    for _ in range(2):  # there and back
        after(page, lambda: page.get_by_role("switch", name="diffuse").tap())
    button.tap()
    expect(scene).to_be_hidden()


def test_fingers_turn_and_zoom_beside_an_open_drawer(page: Page) -> None:
    whole = height_seen(page)
    page.get_by_role("button", name="scene", exact=True).tap()
    until(page, lambda: height_seen(page) < 0.5 * whole)
    page.wait_for_function(REFINED)
    touch = fingers_on(page)

    def seen() -> dict[str, object]:
        found: dict[str, object] = page.evaluate("() => window.volsplatViewport.view")
        return found

    def turn() -> None:
        touch("touchStart", (150, 250))
        touch("touchMove", (200, 280))
        touch("touchMove", (230, 300))
        touch("touchEnd")

    def spread() -> None:
        pinch(touch, ((170, 250), (220, 250)), ((140, 250), (250, 250)))

    first = seen()
    after(page, turn)
    turned = seen()
    assert turned["rotation"] != first["rotation"] and turned["zoom"] == first["zoom"]
    after(page, spread)
    assert seen()["rotation"] == turned["rotation"]
    assert float(str(seen()["zoom"])) > 1.5 * float(str(turned["zoom"]))
    page.get_by_role("button", name="scene", exact=True).tap()
    until(page, lambda: height_seen(page) == whole)


def test_a_finger_scrolls_the_tables_unless_it_is_at_a_point(page: Page) -> None:
    button, drawer = page.get_by_role("button", name="tables", exact=True), panels(page)[1]
    button.tap()
    points = page.get_by_role("region", name="Opacity").locator("circle[role=slider]")
    points.first.wait_for()
    scrolled = "(drawer) => drawer.scrollTop"

    def told() -> list[tuple[str | None, ...]]:
        names = ("aria-valuenow", "aria-valuetext", "cx", "cy")
        return [tuple(point.get_attribute(name) for name in names) for point in points.all()]

    def swipe(place: tuple[float, float], across: float, up: float) -> None:
        touch("touchStart", place)
        for part in range(1, 11):
            touch("touchMove", (place[0] + across * part / 10, place[1] - up * part / 10))
        touch("touchEnd")

    touch, before = fingers_on(page), told()
    first, second = (middle_of(point) for point in points.all()[:2])
    on_line = ((first[0] + second[0]) / 2, (first[1] + second[1]) / 2)
    swipe(on_line, 0, 60)
    until(page, lambda: drawer.evaluate(scrolled) > 30)
    until(page, lambda: len(told()) == len(before))
    page.wait_for_function(REFINED)
    assert told() == before
    drawer.evaluate("(drawer) => { drawer.scrollTop = 0; }")
    until(page, lambda: middle_of(points.first) == first)
    swipe(second, 5, 30 if second[1] > first[1] else -30)
    until(page, lambda: told() != before)
    assert len(told()) == len(before) and drawer.evaluate(scrolled) == 0
    page.wait_for_function(REFINED)
    page.get_by_label("undo", exact=True).tap()
    until(page, lambda: told() == before)
    button.tap()


def middle_of(point: Locator) -> tuple[float, float]:
    place = box(point)
    return place["x"] + place["width"] / 2, place["y"] + place["height"] / 2


def test_all_of_the_picture_is_seen_above_a_drawer_of_a_telephone(page: Page) -> None:
    def fills(share: float) -> bool:
        canvas, seen = page.locator(".vs-picture").bounding_box(), height_seen(page)
        assert canvas is not None
        return abs(seen - canvas["height"]) <= 2 and abs(seen - share * whole) <= 2

    whole = height_seen(page)
    button = page.get_by_role("button", name="tables", exact=True)
    button.tap()
    until(page, lambda: fills(0.48))
    page.wait_for_function(REFINED)
    button.tap()
    until(page, lambda: fills(1.0))


def test_keys_reach_what_a_drawer_holds_and_leave_it(page: Page) -> None:
    from playwright.sync_api import expect

    scene, _ = panels(page)
    page.get_by_role("button", name="to the bounds", exact=True).focus()
    page.keyboard.press("Enter")
    expect(scene).to_be_visible()
    expect(scene.locator(":focus")).to_have_count(1)
    page.keyboard.press("Escape")
    expect(scene).to_be_hidden()
    expect(page.get_by_role("button", name="scene", exact=True)).to_be_focused()
    page.set_viewport_size(window_of((1280, 800)))
    expect(scene).to_be_visible()
    expect(page.get_by_role("button", name="scene", exact=True)).to_be_hidden()


def test_nothing_that_is_read_beside_slices_lies_over_another_is_cut_off_or_too_small(page: Page) -> None:
    page.get_by_role("button", name="three slices").tap()
    page.get_by_role("button", name="colours of the tables").tap()
    page.wait_for_function("() => document.querySelectorAll('.vs-slice[data-shown]').length === 3")
    for width, height in (TELEPHONE, (360, 640), (768, 1024), (1280, 800), (1440, 900), TABLET):
        page.set_viewport_size(window_of((width, height)))
        # The bar is drawn anew for its room, the scale with the picture.
        until(page, lambda: page.evaluate(CLASHES, LEAST_LEGIBLE) == [])


def test_a_dialog_lies_within_a_small_window_and_says_its_name(page: Page) -> None:
    for item, name in (("figure…", "Figure"), ("movie…", "Movie")):
        page.get_by_role("button", name="save").tap()
        page.get_by_text(item).tap()
        dialog = page.get_by_role("dialog")
        dialog.get_by_text(name, exact=True).wait_for()
        for width, height in (TELEPHONE, (360, 640), TABLET):
            page.set_viewport_size(window_of((width, height)))
            until(page, lambda: page.evaluate(SIDES_OF_DIALOG) == [True, True])
        dialog.get_by_role("button", name="close").tap()
        dialog.wait_for(state="hidden")
        page.set_viewport_size(window_of(TELEPHONE))
