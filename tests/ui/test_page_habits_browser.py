"""What people do on a page out of habit: undo, keys before a click, a second window, a reload after a link."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Literal

import psutil
import pytest
import torch

from support.pages.browser import browser, browser_page, close_tab
from support.pages.lossy_line import LossyLine
from support.pages.page_tab import after, canvas, drag, fresh_page, opened, page
from support.pages.tables_tab import box, until
from support.pages.viewed import Viewed
from volsplat.bench.page_drag import REFINED
from volsplat.bench.slow_link import slow_link

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page", "fresh_page", "page"]


def picture_size(page: Page) -> list[int]:
    size: list[int] = page.evaluate(
        "() => { const p = window.volsplatViewport.log.at(-1); return [p.width, p.height] }"
    )
    return size


def middle(page: Page) -> tuple[float, float]:
    """Of the picture, in the window."""
    place = box(page.locator(".vs-picture"))
    return place["x"] + place["width"] / 2, place["y"] + place["height"] / 2


# -- undo


def test_a_turn_and_a_click_that_centres_are_undone(page: Page) -> None:
    before = canvas(page)
    turned = after(page, lambda: drag(page, 60, 20))
    x, y = middle(page)
    centred = after(page, lambda: page.mouse.click(x + 30, y + 30))
    assert not torch.equal(centred, turned)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+z")), turned)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+z")), before)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+Shift+z")), turned)


def dragged(page: Page, button: Literal["left", "right"] = "left", held: tuple[str, ...] = ()) -> None:
    """With these keys held."""
    x, y = middle(page)
    for key in held:
        page.keyboard.down(key)
    page.mouse.move(x, y)
    page.mouse.down(button=button)
    page.mouse.move(x + 50, y + 20, steps=5)
    page.mouse.up(button=button)
    for key in held:
        page.keyboard.up(key)


def zoomed(page: Page) -> None:
    x, y = middle(page)
    page.mouse.move(x + 30, y + 10)
    page.mouse.wheel(0, -200)


MOVES: dict[str, Callable[[Page], None]] = {
    "wheel": zoomed,
    "pan": lambda page: dragged(page, held=("Shift",)),
    "pan by the right button": lambda page: dragged(page, button="right"),
    "roll": lambda page: dragged(page, held=("Control",)),
    **{key: partial(lambda key, page: page.keyboard.press(key), key) for key in ("ArrowUp", "Shift+ArrowLeft", *"+[5")},
}


@pytest.mark.parametrize("move", MOVES)
def test_any_move_of_the_camera_is_undone(page: Page, move: str) -> None:
    before = canvas(page)
    moved = after(page, lambda: MOVES[move](page))
    assert not torch.equal(moved, before)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+z")), before)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+Shift+z")), moved)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+z")), before)


def test_a_table_point_that_was_dragged_goes_back_by_keys(page: Page) -> None:
    before = canvas(page)
    point = box(page.locator('section[aria-label="Opacity"] circle[role=slider]').last)
    x, y = point["x"] + point["width"] / 2, point["y"] + point["height"] / 2

    def pull() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 10, y + 25, steps=5)
        page.mouse.up()

    assert not torch.equal(after(page, pull), before)
    assert torch.equal(after(page, lambda: page.keyboard.press("Control+z")), before)


# -- keys


def test_keys_work_on_a_fresh_page(fresh_page: Page) -> None:
    page = fresh_page
    before, colours = canvas(page), page.locator(".vs-colours")
    page.keyboard.press("c")
    colours.wait_for()
    page.keyboard.press("?")
    page.get_by_text("show or hide this list").wait_for()
    colours.wait_for(state="hidden")  # they would lie on the list
    page.keyboard.press("Escape")
    page.get_by_text("show or hide this list").wait_for(state="hidden")
    colours.wait_for()
    assert not torch.equal(after(page, lambda: page.keyboard.press("5")), before)
    turned = after(page, lambda: page.keyboard.press("ArrowRight"))
    page.get_by_role("button", name="Presets").focus()
    assert not torch.equal(after(page, lambda: page.keyboard.press("2")), turned)


def test_what_is_typed_or_moved_by_arrows_is_not_for_the_viewport(page: Page) -> None:
    sent = "() => window.volsplatViewport.sent.length"
    before = page.evaluate(sent)
    field = page.get_by_label("centre i")
    field.select_text()
    page.keyboard.type("1f5?")
    page.get_by_text("“1f5?” is not a number").wait_for()
    page.keyboard.type("f?")
    page.get_by_text("“1f5?f?” is not a number").wait_for()
    assert field.input_value() == "1f5?f?"
    page.keyboard.press("Escape")
    shift = page.get_by_label("shift of all tables by value")
    unmoved = shift.get_attribute("aria-valuenow")
    shift.focus()
    page.keyboard.press("ArrowRight")
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").wait_for()
    page.keyboard.press("f")
    page.keyboard.press("Escape")
    assert page.evaluate(sent) == before
    assert page.get_by_text("show or hide this list").is_hidden()
    page.get_by_label("undo", exact=True).click()
    until(page, lambda: shift.get_attribute("aria-valuenow") == unmoved)


# -- windows


def test_a_smaller_window_takes_the_picture_only_for_as_long_as_it_is_used(view: Viewed, page: Page) -> None:
    size = picture_size(page)
    small = page.context.new_page()
    small.set_viewport_size({"width": 1000, "height": 600})
    opened(small, view.url)
    until(page, lambda: picture_size(page) == picture_size(small))
    assert picture_size(small) != size
    page.bring_to_front()
    drag(page, 20, 5)
    page.wait_for_function(REFINED)
    assert picture_size(page) == size
    until(small, lambda: picture_size(small) == size)
    small.bring_to_front()
    drag(small, 20, 5)
    small.wait_for_function(REFINED)
    until(page, lambda: picture_size(page) == picture_size(small))
    close_tab(small)
    page.wait_for_function(REFINED)
    assert picture_size(page) == size


def test_a_page_that_a_link_opened_keeps_what_was_done_since_when_it_is_loaded_anew(
    view: Viewed, fresh_page: Page
) -> None:
    page = fresh_page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").click()
    page.get_by_text("copied").wait_for()
    link = page.evaluate("() => navigator.clipboard.readText()")
    opened(page, link)
    assert page.url == f"http://127.0.0.1:{view.port}/"
    turned = after(page, lambda: drag(page, -70, 20))
    page.reload()
    page.wait_for_function(REFINED)
    assert torch.equal(canvas(page), turned)


COPIES_IN_A_CLICK_ALONE = """() => {
    let clicked = false;
    const note = () => { clicked = true; setTimeout(() => { clicked = false; }); };
    window.addEventListener("click", note, true);
    const write = async ([item]) => {
        if (!clicked) throw new Error("nobody has clicked");
        window.copied = await (await item.getType("text/plain")).text();
    };
    Object.defineProperty(navigator, "clipboard", { value: { write } });
}"""


def test_a_link_is_copied_by_the_click_however_late_it_is_known(view: Viewed, fresh_page: Page) -> None:
    page = fresh_page
    page.evaluate(COPIES_IN_A_CLICK_ALONE)
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").click()
    page.get_by_text("copied: the link restores").wait_for()
    assert page.evaluate("() => window.copied").startswith(f"http://127.0.0.1:{view.port}/?scene=")


def test_a_link_that_the_browser_does_not_copy_is_shown(view: Viewed, fresh_page: Page) -> None:
    page = fresh_page
    page.evaluate("() => Object.defineProperty(navigator, 'clipboard', { value: undefined })")
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").click()
    page.get_by_text("copy the link from here").wait_for()
    link = page.get_by_label("link to this scene")
    assert link.input_value().startswith(f"http://127.0.0.1:{view.port}/?scene=")
    page.get_by_role("button", name="close").click()
    link.wait_for(state="hidden")


# -- lines that stall


def test_a_stalled_line_is_told_by_one_voice_and_what_the_hand_did_meanwhile_is_drawn(view: Viewed, page: Page) -> None:
    from playwright.sync_api import expect

    before = canvas(page)
    status = page.locator(".vs-trouble")
    frozen = psutil.Process(view.process.pid)

    def drag_while_it_stands_still() -> None:
        frozen.suspend()
        try:
            expect(status).to_contain_text("does not answer")
            drag(page, 50, 10)
            expect(page.locator("#popup")).to_be_hidden()
        finally:
            frozen.resume()
        expect(status).to_be_hidden()

    assert not torch.equal(after(page, drag_while_it_stands_still), before)


def test_a_cut_line_is_told_by_one_voice_and_the_page_finds_back(view: Viewed, browser_page: Page) -> None:
    from playwright.sync_api import expect

    page = browser_page
    status, popup = page.locator(".vs-trouble"), page.locator("#popup")
    with slow_link(view.port, bits_per_second=1e9, round_trip=0.0) as port:
        opened(page, view.url.replace(f":{view.port}/", f":{port}/"))
        before = canvas(page)
    expect(status).to_contain_text("No connection")
    # NiceGUI has noticed it as well, and would say so.
    page.wait_for_function("() => document.getElementById('popup').ariaHidden === 'false'")
    expect(popup).to_be_hidden()
    drag(page, 50, 10)
    with slow_link(view.port, bits_per_second=1e9, round_trip=0.0, at=port):
        expect(status).to_be_hidden()
        page.wait_for_function(REFINED)
        until(page, lambda: not torch.equal(canvas(page), before))
        page.goto("about:blank")


def test_what_panels_tell_a_line_that_is_cut_comes_to_the_process_and_once(view: Viewed, browser_page: Page) -> None:
    page = browser_page
    line = LossyLine(page)
    before = canvas(opened(page, view.url))
    switch = page.get_by_role("switch", name="diffuse")
    left, right = (page.get_by_role("button", name=f"roll {side}") for side in ("left", "right"))

    def switched_where_events_are_lost() -> None:
        page.wait_for_function("() => window.socket.connected")  # or what is lost is that it connects
        line.loses_events = True
        switch.click()
        line.cut_once_lost('"event"')

    assert not torch.equal(after(page, switched_where_events_are_lost), before)
    assert torch.equal(after(page, switch.click), before)

    def rolled_where_answers_are_lost() -> None:
        line.loses_answers = True
        left.click()

    assert not torch.equal(after(page, rolled_where_answers_are_lost), before)
    line.cut_once_lost("43")  # how Socket.IO's answers begin
    assert torch.equal(after(page, right.click), before), "it was rolled twice"


def test_a_line_that_stands_still_for_long_leaves_the_page_and_what_was_typed_as_they_are(
    view: Viewed, fresh_page: Page
) -> None:
    page = fresh_page
    field, frozen = page.get_by_label("centre i"), psutil.Process(view.process.pid)
    page.evaluate(
        """() => {
            const { socket } = window;
            window.timeouts = 0;
            socket.on("connect_error", ({ message }) => (window.timeouts += message === "timeout"));
            for (const setting of ["timeout", "reconnectionDelay", "reconnectionDelayMax"]) socket.io[setting](100);
        }"""
    )
    frozen.suspend()
    try:
        page.evaluate("() => window.socket.io.engine.close()")
        field.fill("north")
        page.wait_for_function("() => window.timeouts >= 3")
    finally:
        frozen.resume()
    page.get_by_text("“north” is not a number").wait_for()
    field.press("Escape")


def test_what_is_typed_and_not_entered_outlives_that_the_page_is_loaded_anew(page: Page) -> None:
    from playwright.sync_api import expect

    field, told = page.get_by_label("centre i"), page.get_by_text("“north” is not a number")
    value = field.input_value()
    field.fill("north")
    told.wait_for()
    page.reload()
    expect(field).to_have_value("north")
    expect(field).to_be_focused()
    told.wait_for()
    page.get_by_label("centre j").focus()
    page.reload()
    page.wait_for_function(REFINED)
    expect(field).to_have_value(value)


# -- what moves


def test_what_moves_is_drawn_by_the_finest_step_lit_and_smooth(page: Page) -> None:
    x, y = middle(page)
    page.evaluate("() => { window.volsplatViewport.log.length = 0; }")
    page.mouse.move(x, y)
    page.mouse.down()
    places = itertools.cycle(range(40))

    def moves_on() -> bool:  # moves that come while a picture is drawn are one
        page.mouse.move(x + next(places), y)
        return bool(page.evaluate("() => window.volsplatViewport.log.length > 3"))

    until(page, moves_on)
    steps = set(page.evaluate("() => window.volsplatViewport.log.map((picture) => picture.step)"))
    page.mouse.up()
    assert steps == {"F"}


# -- panels that are folded


def test_a_panel_is_folded_by_its_heading_also_by_keys_and_after_loading_anew(page: Page) -> None:
    heading = page.get_by_role("button", name="Shading", exact=True)
    wire = page.get_by_role("radio", name="Opacity by value")
    assert wire.is_visible() and heading.get_attribute("aria-expanded") == "true"
    heading.click()
    wire.wait_for(state="hidden")
    opened(page, page.url)
    wire.wait_for(state="hidden")
    heading.focus()
    page.keyboard.press("Enter")
    wire.wait_for(state="visible")


def test_a_panel_is_resized_by_its_edge_also_by_keys_and_after_loading_anew(page: Page) -> None:
    """Never so far that it or the picture is of no use; and the picture is drawn in the size that is left."""
    window = page.viewport_size
    assert window is not None
    edge = page.get_by_role("separator", name="width of the scene's panel")

    def widths() -> tuple[float, float, list[int]]:
        """Of the panel, as the edge says it and as it is; and of the picture."""
        return (
            float(edge.get_attribute("aria-valuenow") or 0),
            box(page.locator(".vs-left"))["width"],
            picture_size(page),
        )

    own, *_, before = widths()
    at, y = box(edge), window["height"] / 2
    page.mouse.move(at["x"] + at["width"] / 2, y)
    page.mouse.down()
    page.mouse.move(at["x"] + at["width"] / 2 + 60, y, steps=3)
    page.mouse.up()
    until(page, lambda: picture_size(page)[0] == before[0] - 60)
    assert widths()[:2] == (own + 60, own + 60)
    edge.focus()
    page.keyboard.press("ArrowLeft")
    assert widths()[:2] == (own + 44, own + 44)
    opened(page, page.url)
    assert widths()[:2] == (own + 44, own + 44)
    for key, limit in (("Home", "aria-valuemin"), ("End", "aria-valuemax")):
        edge.focus()
        page.keyboard.press(key)
        assert widths()[0] == widths()[1] == float(edge.get_attribute(limit) or 0)
        assert box(page.locator(".vs-view"))["width"] >= 320
    other = page.get_by_role("separator", name="width of the tables")
    other.focus()
    for key, sign in (("ArrowLeft", 1), ("ArrowRight", -1)):
        width = box(page.locator(".vs-right"))["width"]
        page.keyboard.press(key)
        assert (box(page.locator(".vs-right"))["width"] - width) * sign >= 0
    page.keyboard.press("Enter")
    edge.dblclick(position={"x": 4, "y": 100})
    assert widths()[:2] == (own, own)
    page.keyboard.press("a")  # no picture's key
    until(page, lambda: picture_size(page) == before)


def test_cells_of_the_cross_bar_are_large_enough_for_a_finger(page: Page) -> None:
    sizes = [box(cell) for cell in page.locator(".vs-wires input").all()]
    assert len(sizes) == 44 and all(size["width"] >= 24 and size["height"] >= 24 for size in sizes)


@pytest.mark.parametrize("width", [1280, 1920, 3840])
def test_no_row_of_buttons_is_cut_off_and_what_the_head_says_is_as_large_as_all_else(page: Page, width: int) -> None:
    own = page.viewport_size
    assert own is not None
    page.set_viewport_size({"width": width, "height": width * 9 // 16})
    cut_off = page.evaluate(
        """() => [...document.querySelectorAll(".vs-buttons, .vs-toggle")]
            .filter((row) => row.scrollWidth > row.clientWidth).map((row) => row.textContent)"""
    )
    assert cut_off == []
    page.get_by_role("button", name="light or dark").hover()
    tooltip = page.locator(".q-tooltip")
    tooltip.wait_for()
    save = page.get_by_role("button", name="save", exact=True)
    size = "(part) => getComputedStyle(part).fontSize"
    assert [part.evaluate(size) for part in (tooltip, save)] == [page.locator("body").evaluate(size)] * 2
    page.set_viewport_size(own)
    page.mouse.move(0, 0)
    tooltip.wait_for(state="hidden")
