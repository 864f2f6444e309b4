"""The viewport in a real browser, over a real socket: what a person's mouse, wheel, fingers and keys say."""

from __future__ import annotations

import math
from typing import Any

import pytest
from playwright.sync_api import Browser, Page

from support.pages.browser import browser, browser_page, patient_context, serving
from support.pages.fingers import SAFARI_PINCH, fingers_on, pinch
from support.pages.viewport_process import (
    FIT,
    SIZE,
    VIEW,
    VOLUME,
    Message,
    ShownViewport,
    ViewportProcess,
    shown,
    viewport_server,
)
from tolerances import CAMERA_PIXELS, ROUNDING
from volsplat.protocol.description.view_rotation import named_view
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector

__all__ = ["browser", "browser_page", "shown", "viewport_server"]

MIDDLE = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
PIXELS_PER_VOXEL = VIEW["zoom"] / VOLUME["reference_spacing"]  # along i, seen from the front
TURN = math.radians(5)  # of an arrow key


def drag(page: Page, start: tuple[float, float], end: tuple[float, float], button: Any = "left") -> None:
    page.mouse.move(*start)
    page.mouse.down(button=button)
    page.mouse.move(*end, steps=5)
    page.mouse.up(button=button)


def on_screen(view: Message, direction: Vector) -> Vector:
    """Where a physical direction points on the screen."""
    return matrices.applied(matrices.rotation_from_quaternion(view["rotation"]), direction)


def assert_same_rotation(view: Message, expected: Message) -> None:
    assert view["rotation"] == pytest.approx(expected["rotation"], abs=ROUNDING)


# -- the mouse


def test_a_drag_turns_with_the_pointer_and_settles(shown: ShownViewport) -> None:
    drag(shown.page, (320, 240), (400, 180))
    view = shown.process.wait_for_settled()
    views = shown.process.heard_of("view")
    assert [v["settled"] for v in views] == [False] * (len(views) - 1) + [True]
    assert [v["event"] for v in views] == sorted({v["event"] for v in views})
    assert (view["zoom"], view["center"]) == (VIEW["zoom"], VIEW["center"])
    # What was at the middle of the sphere, nearest to the viewer, is under the pointer now.
    x, y, _ = on_screen(view, matrices.applied(front_to_physical(), (0.5 / 240, -0.5 / 240, 1.0)))
    assert (x * 240, y * 240) == pytest.approx((80.5, 59.5), abs=1)


def front_to_physical() -> matrices.Matrix:
    return matrices.transposed(matrices.rotation_from_quaternion(VIEW["rotation"]))


def test_a_drag_says_the_first_and_the_newest_view_of_many_moves_and_none_twice(shown: ShownViewport) -> None:
    shown.page.mouse.move(320, 240)
    shown.page.mouse.down()
    shown.page.evaluate(
        """() => {
            const canvas = document.querySelector("canvas");
            for (let n = 1; n <= 20; n++) {
                const move = { pointerId: 1, clientX: 320 + 5 * n, clientY: 240, isPrimary: true, bubbles: true };
                for (const kind of ["pointerrawupdate", "pointermove"])
                    canvas.dispatchEvent(new PointerEvent(kind, move));
            }
        }"""
    )
    shown.process.wait_until(lambda: 20 in [v["event"] for v in shown.process.heard_of("view")], "say the last move")
    assert [v["event"] for v in shown.process.heard_of("view")] == [1, 20]
    shown.page.mouse.up()
    assert shown.process.wait_for_settled()["event"] == 21


@pytest.mark.parametrize(("button", "modifier"), [("right", None), ("middle", None), ("left", "Shift")])
def test_other_buttons_and_shift_pan(shown: ShownViewport, button: str, modifier: str | None) -> None:
    if modifier is not None:
        shown.page.keyboard.down(modifier)
    drag(shown.page, (300, 200), (350, 240), button)
    view = shown.process.wait_for_settled()
    assert_same_rotation(view, VIEW)
    # Seen from the front, i runs to the right and k, of spacing 2, up.
    i, j, k = VIEW["center"]
    expected = [i - 50 / PIXELS_PER_VOXEL, j, k + 40 / (2 * PIXELS_PER_VOXEL)]
    assert view["center"] == pytest.approx(expected, abs=CAMERA_PIXELS)


def test_control_drag_rolls(shown: ShownViewport) -> None:
    shown.page.keyboard.down("Control")
    drag(shown.page, (MIDDLE[0] + 100.5, MIDDLE[1] + 0.5), (MIDDLE[0] + 0.5, MIDDLE[1] - 99.5))
    view = shown.process.wait_for_settled()
    before = on_screen(VIEW, (1.0, 0.0, 0.0))
    assert before == pytest.approx((1, 0, 0), abs=ROUNDING)
    assert on_screen(view, (1.0, 0.0, 0.0)) == pytest.approx((0, 1, 0), abs=ROUNDING)


def test_the_wheel_zooms_to_the_pointer_and_settles_after_it(shown: ShownViewport) -> None:
    shown.page.evaluate(  # at once: it settles after a pause
        """([clientX, clientY]) => {
            const wheel = { deltaY: -100, clientX, clientY, bubbles: true, cancelable: true };
            for (let n = 0; n < 3; n++)
                document.elementFromPoint(clientX, clientY).dispatchEvent(new WheelEvent("wheel", wheel));
        }""",
        [MIDDLE[0] + 100.5, MIDDLE[1] + 0.5],
    )
    view = shown.process.wait_for_settled()
    assert [v["settled"] for v in shown.process.heard_of("view")].count(True) == 1
    assert view["zoom"] == pytest.approx(VIEW["zoom"] * 2 ** (300 / 400), rel=ROUNDING)
    under = VIEW["center"][0] + 100 / PIXELS_PER_VOXEL
    still_under = view["center"][0] + 100 / (PIXELS_PER_VOXEL * view["zoom"] / VIEW["zoom"])
    assert still_under == pytest.approx(under, abs=CAMERA_PIXELS)


@pytest.mark.parametrize(
    ("unit", "count", "pixels"),
    [("PIXEL", -100, 100), ("LINE", -3, 99), ("PAGE", -0.25, SIZE[1] / 4), ("PAGE", 1, -200), ("PAGE", -1, 200)],
)
def test_the_wheel_counts_in_what_the_browser_says_and_not_beyond_a_bound(
    shown: ShownViewport, unit: str, count: float, pixels: float
) -> None:
    assert shown.canvas.evaluate("canvas => canvas.parentElement.clientHeight") == SIZE[1]
    shown.canvas.evaluate(
        """(canvas, [unit, deltaY, clientX, clientY]) => {
            const deltaMode = WheelEvent[`DOM_DELTA_${unit}`];
            const wheel = { deltaMode, deltaY, clientX, clientY, bubbles: true, cancelable: true };
            canvas.dispatchEvent(new WheelEvent("wheel", wheel));
        }""",
        [unit, count, *MIDDLE],
    )
    assert shown.process.wait_for_settled()["zoom"] == pytest.approx(VIEW["zoom"] * 2 ** (pixels / 400), rel=ROUNDING)


def test_a_trackpads_pinch_zooms_in_safari(shown: ShownViewport) -> None:
    shown.canvas.evaluate(SAFARI_PINCH, [1.25, 2.0])
    view = shown.process.wait_for_settled()
    assert view["zoom"] == pytest.approx(2 * VIEW["zoom"], rel=ROUNDING)
    assert view["center"] == pytest.approx(VIEW["center"], abs=CAMERA_PIXELS)


@pytest.mark.parametrize("moved", [0, 2])
def test_a_click_centres_what_is_there(shown: ShownViewport, moved: int) -> None:
    drag(shown.page, (200, 100), (200 + moved, 100))
    center = shown.process.wait_for("center")
    assert (center["x"], center["y"]) == (199.5 + moved, 99.5)
    assert shown.process.heard_of("view") == []


def test_a_drag_back_to_where_it_began_is_no_click(shown: ShownViewport) -> None:
    shown.page.mouse.move(200, 100)
    shown.page.mouse.down()
    shown.page.mouse.move(260, 100)
    shown.page.mouse.move(200, 100)
    shown.page.mouse.up()
    assert_same_rotation(shown.process.wait_for_settled(), VIEW)
    shown.show_and_wait()
    assert shown.process.heard_of("center") == []


def test_without_inertia_a_drag_ends_when_let_go(shown: ShownViewport) -> None:
    drag(shown.page, (320, 240), (400, 240))
    last = shown.process.wait_for_settled()["event"]
    shown.frames(3)
    shown.show_and_wait()
    assert shown.process.heard_of("view")[-1]["event"] == last


def throw(shown: ShownViewport) -> None:
    """Let the volume go amid a quick turn."""
    shown.page.evaluate("volsplatViewport.steering.inertia = true")
    shown.page.evaluate(
        """() => {
            const canvas = document.querySelector("canvas");
            const say = (type, x, at) => {
                const event = new PointerEvent(type, { pointerId: 1, clientX: x, clientY: 240, bubbles: true });
                Object.defineProperty(event, "timeStamp", { value: at });
                canvas.dispatchEvent(event);
            };
            canvas.setPointerCapture = () => {};
            const now = performance.now();
            say("pointerdown", 320, now - 40);
            for (let n = 1; n <= 4; n++) say("pointermove", 320 + 10 * n, now - 40 + 10 * n);
            say("pointerup", 360, now);
        }"""
    )


def test_with_inertia_the_volume_turns_on_and_comes_to_rest(shown: ShownViewport) -> None:
    throw(shown)
    view = shown.process.wait_for_settled()
    x, _, _ = on_screen(view, matrices.applied(front_to_physical(), (0.0, 0.0, 1.0)))
    assert abs(math.degrees(math.asin(40 / 240)) - math.degrees(math.asin(x))) > 5


@pytest.mark.parametrize("hidden_first", [False, True])
def test_inertia_ends_with_the_tab_out_of_sight_which_has_no_animation_frames(
    shown: ShownViewport, hidden_first: bool
) -> None:
    hide = """() => {
        window.requestAnimationFrame = () => 1;
        Object.defineProperty(document, "hidden", { value: true });
        document.dispatchEvent(new Event("visibilitychange"));
    }"""
    if hidden_first:
        shown.page.evaluate(hide)
    throw(shown)
    if not hidden_first:
        shown.page.evaluate(hide)
    shown.process.wait_for_settled()


# -- keys


@pytest.mark.parametrize(
    ("key", "name"),
    [("1", "front"), ("2", "back"), ("3", "left"), ("4", "right"), ("5", "top"), ("6", "bottom"), ("0", "front")],
)
def test_number_keys_look_from_a_side(shown: ShownViewport, key: str, name: str) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("ArrowUp")
    shown.page.keyboard.press(key)
    view = shown.wait_for_the_last_to_settle()
    assert view["rotation"] == pytest.approx(named_view(name), abs=ROUNDING)
    assert shown.process.heard_of("view")[0]["settled"] is False  # the arrow's; it settles if the number is late


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("ArrowRight", (math.sin(TURN), 0.0, math.cos(TURN))),
        ("ArrowLeft", (-math.sin(TURN), 0.0, math.cos(TURN))),
        ("ArrowUp", (0.0, math.sin(TURN), math.cos(TURN))),
        ("ArrowDown", (0.0, -math.sin(TURN), math.cos(TURN))),
    ],
)
def test_arrows_turn(shown: ShownViewport, key: str, nearest: Vector) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press(key)
    view = shown.process.wait_for_settled()
    assert on_screen(view, (0.0, -1.0, 0.0)) == pytest.approx(nearest, abs=ROUNDING)


@pytest.mark.parametrize(("key", "sign"), [("[", 1), ("]", -1)])
def test_brackets_roll(shown: ShownViewport, key: str, sign: int) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press(key)
    view = shown.process.wait_for_settled()
    expected = (math.cos(TURN), sign * math.sin(TURN), 0.0)
    assert on_screen(view, (1.0, 0.0, 0.0)) == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize(("key", "axis", "sign"), [("ArrowRight", 0, -1), ("ArrowUp", 2, -1)])
def test_shifted_arrows_pan(shown: ShownViewport, key: str, axis: int, sign: int) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press(f"Shift+{key}")
    view = shown.process.wait_for_settled()
    moved = [new - old for new, old in zip(view["center"], VIEW["center"], strict=True)]
    assert math.copysign(1, moved[axis]) == sign
    assert sum(abs(part) > ROUNDING for part in moved) == 1


def test_plus_and_minus_zoom(shown: ShownViewport) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("+")
    assert shown.process.wait_for_settled()["zoom"] == pytest.approx(VIEW["zoom"] * 1.25)
    shown.process.forget()
    shown.page.keyboard.press("-")
    assert shown.process.wait_for_settled()["zoom"] == pytest.approx(VIEW["zoom"])


def test_zooming_out_ends_before_the_volume_is_a_dot(shown: ShownViewport) -> None:
    shown.canvas.focus()
    for _ in range(20):
        shown.page.keyboard.press("-")
    assert shown.wait_for_the_last_to_settle()["zoom"] == pytest.approx(FIT["zoom"] / 8)
    shown.page.keyboard.press("+")
    assert shown.wait_for_the_last_to_settle()["zoom"] == pytest.approx(1.25 * FIT["zoom"] / 8)


@pytest.mark.parametrize("key", ["0", "f"])
def test_reset_and_fit_show_what_the_process_says_is_visible(shown: ShownViewport, key: str) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("+")
    shown.page.keyboard.press("Shift+ArrowUp")
    shown.page.keyboard.press(key)
    view = shown.wait_for_the_last_to_settle()
    assert (view["zoom"], view["center"]) == (FIT["zoom"], FIT["center"])
    assert_same_rotation(view, VIEW)


def test_while_somebody_is_at_the_tables_the_last_fit_is_kept(shown: ShownViewport) -> None:
    shown.process.say_scene(settled=False, fit=None)
    shown.canvas.focus()
    shown.page.keyboard.press("f")
    view = shown.wait_for_the_last_to_settle()
    assert (view["zoom"], view["center"]) == (FIT["zoom"], FIT["center"])


def test_undo_and_redo_are_asked_for(shown: ShownViewport) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("Control+z")
    shown.process.wait_for("undo")
    shown.page.keyboard.press("Control+Shift+z")
    shown.process.wait_for("redo")
    assert shown.process.heard_of("view") == []


def test_keys_without_latin_letters_do_what_those_in_their_place_do(shown: ShownViewport) -> None:
    pressed = """(canvas, [key, code, ctrlKey]) => {
        const event = new KeyboardEvent("keydown", { key, code, ctrlKey, bubbles: true, cancelable: true });
        if (canvas.dispatchEvent(event)) throw new Error(`${key} is left to the browser`);
    }"""
    for key, code in (("я", "KeyZ"), ("Я", "KeyZ")):
        shown.canvas.evaluate(pressed, [key, code, True])
    shown.process.wait_for("undo", 2)
    shown.canvas.evaluate(pressed, ["х", "BracketLeft", False])
    turned = shown.process.wait_for_settled()
    assert turned["rotation"] != pytest.approx(VIEW["rotation"], abs=ROUNDING)
    shown.canvas.evaluate(pressed, ["а", "KeyF", False])
    assert shown.wait_for_the_last_to_settle()["zoom"] == FIT["zoom"]


def test_the_list_of_keys_opens_and_closes(shown: ShownViewport) -> None:
    keys = shown.page.get_by_text("show or hide this list")
    assert not keys.is_visible()
    shown.canvas.focus()
    shown.page.keyboard.press("?")
    keys.wait_for()
    shown.page.keyboard.press("Escape")
    keys.wait_for(state="hidden")
    shown.page.get_by_title("keys").click()
    keys.wait_for()


# -- fingers


def test_one_finger_turns_and_two_zoom(browser: Browser) -> None:
    process = ViewportProcess()
    with serving(process.application) as url, patient_context(browser, has_touch=True) as context:
        shown = ShownViewport(context.new_page(), process, url)
        touch = fingers_on(shown.page)
        touch("touchStart", (320, 240))
        touch("touchMove", (360, 240))
        touch("touchMove", (400, 240))
        touch("touchEnd")
        turned = process.wait_for_settled()
        assert turned["zoom"] == VIEW["zoom"]
        assert on_screen(turned, (0.0, -1.0, 0.0))[0] > 0.25

        process.forget()
        pinch(touch, ((300, 240), (340, 240)), ((280, 240), (360, 240)), ((260, 240), (380, 240)))
        pinched = process.wait_for_settled()
        assert pinched["zoom"] == pytest.approx(3 * VIEW["zoom"], rel=ROUNDING)
        assert_same_rotation(pinched, turned)
        assert process.heard_of("center") == []


# -- others change the view


def test_a_view_that_another_tab_sets_is_taken_over(shown: ShownViewport) -> None:
    shown.process.say_scene(by="t2", view={**VIEW, "rotation": named_view("top"), "zoom": 3.0})
    shown.show_and_wait()  # older than that scene
    shown.canvas.focus()
    shown.page.keyboard.press("f")
    assert shown.process.wait_for("view")["rotation"] == pytest.approx(named_view("top"), abs=ROUNDING)


def test_a_drag_is_not_pulled_away(shown: ShownViewport) -> None:
    shown.page.mouse.move(320, 240)
    shown.page.mouse.down()
    shown.page.mouse.move(330, 240)
    shown.process.wait_for("view")
    shown.process.say_scene(by="t2", view={**VIEW, "zoom": 3.0})
    shown.show_and_wait(view={**VIEW, "zoom": 3.0})
    shown.page.mouse.move(340, 240)
    shown.page.mouse.up()
    assert shown.process.wait_for_settled()["zoom"] == VIEW["zoom"]


def test_an_echo_of_an_older_view_does_not_pull_back(shown: ShownViewport) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("5")
    older = shown.process.wait_for("view")
    shown.page.keyboard.press("1")
    shown.process.say_scene(view=older)
    shown.show_and_wait(view=older, event=1)
    shown.page.keyboard.press("ArrowRight")
    view = shown.process.wait_for_settled_after(2)
    assert on_screen(view, (0.0, -1.0, 0.0))[0] == pytest.approx(math.sin(TURN), abs=ROUNDING)


def test_what_the_process_made_of_a_view_is_taken_over(shown: ShownViewport) -> None:
    shown.canvas.focus()
    shown.page.keyboard.press("5")
    shown.process.wait_for("view")
    shown.process.say_scene(view={**VIEW, "zoom": 2.0})
    shown.show_and_wait(event=1)
    shown.page.keyboard.press("1")
    assert shown.process.wait_for("view", 2)["zoom"] == 2.0


def test_a_held_key_settles_once_it_is_let_go(shown: ShownViewport) -> None:
    shown.canvas.focus()
    for _ in range(8):
        shown.page.keyboard.down("ArrowRight")
    shown.page.keyboard.up("ArrowRight")
    view = shown.process.wait_for_settled_after(8)
    assert on_screen(view, (0.0, -1.0, 0.0))[0] == pytest.approx(math.sin(8 * TURN), abs=ROUNDING)
