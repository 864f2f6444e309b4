"""The handles of the bounds and the sides of the cube without a mouse: by keys, and as screen readers hear of them."""

from __future__ import annotations

import pytest
from playwright.sync_api import Locator, expect

from support.pages.browser import browser, browser_page
from support.pages.viewport_process import VIEW, VOLUME, ShownViewport, shown, viewport_server
from tolerances import CAMERA_PIXELS
from volsplat.protocol.description.view_rotation import VIEW_NAMES, named_view, rotation_from_angles

__all__ = ["browser", "browser_page", "shown", "viewport_server"]

DIMS = VOLUME["dims"]
# A hand at the view, which is somewhere else than the focus.
HOLD = "() => { const { steering, view } = volsplatViewport; steering.hold(); steering.drag(view, performance.now()); }"
LET_GO = "() => volsplatViewport.steering.release(performance.now())"
PRESS_AT_ONCE = """(presses) => {
    for (const press of presses) {
        const [key, held] = press.split("+").reverse();
        const options = { key, ctrlKey: held === "Control", metaKey: held === "Meta", bubbles: true, cancelable: true };
        document.activeElement.dispatchEvent(new KeyboardEvent("keydown", options));
    }
}"""
LET_KEY_GO = "(key) => document.activeElement.dispatchEvent(new KeyboardEvent('keyup', { key, bubbles: true }))"
SHOWN_IN_FRONT = ["lowest i", "end of i", "lowest k", "end of k"]  # j runs away from the viewer


def handle(shown: ShownViewport, end: str) -> Locator:
    return shown.page.get_by_role("slider", name=f"{end}, a handle", exact=True)


def side(shown: ShownViewport, view: str) -> Locator:
    return shown.page.get_by_role("button", name=f"look from the {view} ({VOLUME['sides'][view]})", exact=True)


def tab_from_the_picture(shown: ShownViewport, times: int = 1) -> None:
    shown.canvas.focus()
    for _ in range(times):
        shown.page.keyboard.press("Tab")


def says(end: Locator, value: int, least: int, most: int) -> None:
    for name, number in (("valuenow", value), ("valuetext", value), ("valuemin", least), ("valuemax", most)):
        expect(end).to_have_attribute(f"aria-{name}", str(number))


# -- handles


def test_handles_are_one_stop_and_arrows_go_round_those_that_are_shown(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    for end in (*SHOWN_IN_FRONT, SHOWN_IN_FRONT[0]):
        expect(handle(shown, end)).to_be_focused()
        expect(shown.page.get_by_text(f"{end} = ")).to_be_visible()
        shown.page.keyboard.press("ArrowRight")
    for end in (SHOWN_IN_FRONT[0], SHOWN_IN_FRONT[-1]):
        shown.page.keyboard.press("ArrowLeft")
        expect(handle(shown, end)).to_be_focused()
    shown.page.keyboard.press("Tab")
    expect(shown.page.locator(".vs-handle:focus")).to_have_count(0)
    shown.page.keyboard.press("Shift+Tab")
    expect(handle(shown, SHOWN_IN_FRONT[-1])).to_be_focused()
    assert shown.page.get_by_role("slider").count() == len(SHOWN_IN_FRONT)
    assert shown.process.heard_of("bounds") == shown.process.heard_of("view") == []


def test_keys_cut_as_a_drag_does_and_the_value_follows(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    lowest, end = handle(shown, "lowest i"), handle(shown, "end of i")
    says(lowest, 0, 0, DIMS[0] - 1)
    says(end, DIMS[0], 1, DIMS[0])
    for key, low in (("ArrowUp", 1), ("PageUp", 11), ("ArrowDown", 10), ("End", DIMS[0] - 1), ("PageDown", 53)):
        shown.process.forget()
        shown.page.keyboard.press(key)
        said = shown.process.wait_for_settled("bounds")
        assert (said["low"], said["high"]) == ([low, 0, 0], DIMS)
        assert [one["settled"] for one in shown.process.heard_of("bounds")] == [False, True]
        says(lowest, low, 0, DIMS[0] - 1)
        says(end, DIMS[0], low + 1, DIMS[0])
    shown.page.keyboard.press("Home")
    says(lowest, 0, 0, DIMS[0] - 1)
    shown.process.wait_for_settled("bounds")
    shown.process.forget()
    shown.page.keyboard.press("PageDown")  # where there is nothing more
    shown.page.keyboard.press("ArrowRight")
    shown.page.keyboard.press("ArrowDown")
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"], said["high"]) == ([0, 0, 0], [DIMS[0] - 1, *DIMS[1:]])


def test_a_key_that_is_held_is_one_change(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    for _ in range(3):
        shown.page.keyboard.down("ArrowUp")
    shown.page.keyboard.up("ArrowUp")
    assert shown.process.wait_for_settled("bounds")["low"] == [3, 0, 0]
    assert [one["settled"] for one in shown.process.heard_of("bounds")].count(True) == 1
    shown.process.forget()
    shown.page.keyboard.down("ArrowUp")
    shown.page.keyboard.press("Tab")  # the key's end is heard elsewhere
    assert shown.process.wait_for_settled("bounds")["low"] == [4, 0, 0]


@pytest.mark.parametrize(("keys", "asked"), [("Control+z", "undo"), ("Meta+z", "undo"), ("Control+y", "redo")])
def test_what_a_held_key_does_is_settled_before_it_is_undone(shown: ShownViewport, keys: str, asked: str) -> None:
    tab_from_the_picture(shown)
    # All at once, as where the page had no time for any of them.
    shown.page.evaluate(PRESS_AT_ONCE, ["ArrowUp", "ArrowUp", keys])
    shown.process.wait_for(asked)
    said = [one for one in shown.process.heard if one["type"] in ("bounds", asked)]
    assert (said[-1]["type"], said[-2]["settled"], said[-2]["low"]) == (asked, True, [2, 0, 0])
    shown.process.say_scene()
    shown.show_and_wait(event=said[-2]["event"])
    shown.process.forget()
    shown.page.evaluate(LET_KEY_GO, "ArrowUp")
    shown.show_and_wait(event=said[-2]["event"])
    assert shown.process.heard_of("bounds") == []
    says(handle(shown, "lowest i"), 0, 0, DIMS[0] - 1)


OF_ANOTHER_TAB = {"low": [0, 0, 0], "high": [*DIMS[:2], 30]}  # which has not heard of what is done here


def test_a_key_that_is_held_leaves_what_another_tab_does_to_other_faces(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    shown.page.keyboard.down("ArrowUp")
    shown.process.wait_for("bounds")
    shown.process.say_scene(by="t2", bounds=OF_ANOTHER_TAB)
    shown.show_and_wait()
    shown.page.keyboard.up("ArrowUp")
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"], said["high"]) == ([1, 0, 0], OF_ANOTHER_TAB["high"])
    says(handle(shown, "lowest i"), 1, 0, DIMS[0] - 1)
    says(handle(shown, "end of k"), 30, 1, DIMS[2])


def test_what_was_done_here_stays_until_others_can_have_heard_of_it(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    shown.page.keyboard.press("ArrowUp")
    shown.process.wait_for_settled("bounds")
    shown.process.say_scene(by="t2", bounds=OF_ANOTHER_TAB)
    shown.show_and_wait()
    says(handle(shown, "lowest i"), 1, 0, DIMS[0] - 1)
    says(handle(shown, "end of k"), 30, 1, DIMS[2])
    shown.process.forget()
    shown.page.keyboard.press("ArrowRight")
    shown.page.keyboard.press("ArrowDown")
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"], said["high"]) == ([1, 0, 0], [DIMS[0] - 1, DIMS[1], 30])
    shown.process.say_scene(by="t2", bounds=OF_ANOTHER_TAB)
    shown.show_and_wait(event=said["event"])
    says(handle(shown, "lowest i"), 0, 0, DIMS[0] - 1)
    says(handle(shown, "end of i"), DIMS[0], 1, DIMS[0])


def test_with_shift_keys_move_both_ends(shown: ShownViewport) -> None:
    shown.process.say_scene(bounds={"low": [10, 0, 0], "high": [20, *DIMS[1:]]})
    shown.show_and_wait()
    tab_from_the_picture(shown)
    for key, span in (("ArrowUp", [11, 21]), ("PageUp", [21, 31]), ("End", [DIMS[0] - 10, DIMS[0]]), ("Home", [0, 10])):
        shown.process.forget()
        shown.page.keyboard.press(f"Shift+{key}")
        said = shown.process.wait_for_settled("bounds")
        assert [said["low"][0], said["high"][0]] == span
    says(handle(shown, "end of i"), 10, 1, DIMS[0])


def test_what_a_handle_says_waits_until_a_drag_settles(shown: ShownViewport) -> None:
    lowest = handle(shown, "lowest i")
    box = lowest.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 60, y, steps=3)
    shown.process.wait_for("bounds")
    says(lowest, 0, 0, DIMS[0] - 1)
    shown.page.mouse.up()
    low = shown.process.wait_for_settled("bounds")["low"][0]
    says(lowest, low, 0, DIMS[0] - 1)
    assert low > 0


def test_the_box_shows_while_a_handle_has_the_focus(shown: ShownViewport) -> None:
    shown.page.mouse.move(2000, 2000)
    tab_from_the_picture(shown)
    dot, other = (handle(shown, end).locator(".vs-reach") for end in ("lowest i", "end of i"))
    for part in (".vs-edges", ".vs-handles"):
        expect(shown.page.locator(part)).to_have_css("opacity", "1")
    assert dot.evaluate("(dot) => getComputedStyle(dot).stroke") != other.evaluate(
        "(dot) => getComputedStyle(dot).stroke"
    )
    shown.canvas.focus()
    for part in (".vs-edges", ".vs-handles"):
        expect(shown.page.locator(part)).to_have_css("opacity", "0")


def test_a_handle_keeps_the_focus_while_the_view_moves_and_is_not_seen(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    handles = shown.page.locator(".vs-handles")
    expect(handles).to_have_css("opacity", "1")
    shown.page.evaluate(HOLD)
    shown.show_and_wait(view={**VIEW, "rotation": rotation_from_angles(-30, 25)})
    expect(handles).to_have_css("opacity", "0")
    expect(handle(shown, "lowest i")).to_be_focused()
    shown.page.evaluate(LET_GO)
    expect(handles).to_have_css("opacity", "1")
    assert shown.page.get_by_role("slider").count() == 6


def test_no_key_moves_a_face_while_the_view_moves(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    shown.page.evaluate(HOLD)
    shown.show_and_wait()
    shown.process.forget()
    for key in ("ArrowUp", "Shift+PageUp", "End"):
        shown.page.keyboard.press(key)
    shown.page.evaluate(LET_GO)
    shown.process.wait_for_settled("view")
    assert len(shown.process.heard_of("view")) == 1, "nor turns what a hand is at"
    assert shown.process.heard_of("bounds") == []
    shown.page.keyboard.press("ArrowUp")
    assert shown.process.wait_for_settled("bounds")["low"] == [1, 0, 0]


def test_a_handle_is_moved_also_where_its_axis_has_turned_to_the_viewer(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    lowest = handle(shown, "lowest i")
    shown.show_and_wait(view={**VIEW, "rotation": named_view("left")})
    shown.page.keyboard.press("ArrowUp")
    assert shown.process.wait_for_settled("bounds")["low"] == [1, 0, 0]
    says(lowest, 1, 0, DIMS[0] - 1)
    shown.page.keyboard.press("ArrowRight")
    expect(handle(shown, "lowest j")).to_be_focused()
    expect(lowest).to_have_count(0)  # nobody could drag it
    shown.page.keyboard.press("Tab")
    shown.page.keyboard.press("Shift+Tab")
    expect(handle(shown, "lowest j")).to_be_focused()


# -- the cube


def test_the_cube_is_one_stop_whose_arrows_go_round_its_sides(shown: ShownViewport) -> None:
    tab_from_the_picture(shown, 2)
    for view in (*VIEW_NAMES, VIEW_NAMES[0]):
        expect(side(shown, view)).to_be_focused()
        expect(side(shown, view)).to_have_css("opacity", "1")
        shown.page.keyboard.press("ArrowRight")
    shown.page.keyboard.press("Tab")
    assert shown.page.locator(".vs-picture-buttons button:focus").count() == 1
    shown.page.keyboard.press("Shift+Tab")
    expect(side(shown, VIEW_NAMES[1])).to_be_focused()
    assert shown.process.heard_of("view") == []


@pytest.mark.parametrize("key", ["Enter", " "])
def test_a_side_is_looked_from_by_keys_and_marked_on_the_cube(shown: ShownViewport, key: str) -> None:
    cube = shown.page.locator(".vs-cube")
    rests = cube.screenshot()
    tab_from_the_picture(shown, 2)
    assert cube.screenshot() != rests
    expect(cube).to_have_css("outline-style", "solid")
    shown.page.keyboard.press("ArrowLeft")
    expect(side(shown, VIEW_NAMES[-1])).to_be_focused()
    shown.page.keyboard.press(key)
    view = shown.process.wait_for_settled()
    assert view["rotation"] == pytest.approx(named_view(VIEW_NAMES[-1]), abs=CAMERA_PIXELS)
    expect(side(shown, VIEW_NAMES[-1])).to_be_focused()


def test_sides_that_only_keys_reach_lie_in_no_pointers_way(shown: ShownViewport) -> None:
    caption = side(shown, "front").bounding_box()
    assert caption is not None
    shown.page.mouse.click(caption["x"] + caption["width"] / 2, caption["y"] + caption["height"] / 2)
    shown.process.wait_for("center")
    assert shown.process.heard_of("view") == []


# -- both


WATCH = """() => {
    window.changes = [];
    const watch = new MutationObserver((records) => window.changes.push(...records.map(({ type }) => type)));
    for (const part of document.querySelectorAll(".vs-handles, .vs-sides"))
        watch.observe(part, { attributes: true, childList: true, characterData: true, subtree: true });
}"""


def test_nothing_of_them_changes_with_each_moving_picture(shown: ShownViewport) -> None:
    tab_from_the_picture(shown)
    shown.page.evaluate(HOLD)
    shown.show_and_wait()
    shown.page.evaluate(WATCH)
    for turn in (10, 20, 30):
        shown.show_and_wait(view={**VIEW, "rotation": rotation_from_angles(turn, 25)})
    assert shown.page.evaluate("changes") == []
    shown.page.evaluate(LET_GO)
    shown.page.wait_for_function("() => changes.length > 0")
