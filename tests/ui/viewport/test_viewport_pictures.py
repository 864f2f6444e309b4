"""What a viewport shows, in a real browser over a real socket: pictures, the marks over them, troubles, drops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from urllib.parse import urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Locator, Page, expect

from support.pages.browser import browser, browser_page, patient_context, serving
from support.pages.fingers import on_finer_screen
from support.pages.viewport_process import (
    SIZE,
    VIEW,
    VOLUME,
    Message,
    ShownViewport,
    ViewportProcess,
    plain,
    shown,
    viewport_server,
)
from tolerances import CAMERA_PIXELS, HALF_A_CSS_PIXEL
from volsplat.protocol.description.view_rotation import (
    VIEW_NAMES,
    Quaternion,
    about,
    named_view,
    product,
    rotation_from_angles,
)

__all__ = ["browser", "browser_page", "shown", "viewport_server"]

RED, GREEN = (200, 0, 0), (0, 200, 0)
PIXELS_PER_VOXEL = VIEW["zoom"] / VOLUME["reference_spacing"]
OBLIQUE = {**VIEW, "rotation": rotation_from_angles(-30, 25)}
MIDDLE = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)


# -- pictures


def test_a_picture_is_shown_pixel_for_pixel(shown: ShownViewport) -> None:
    number = shown.show_and_wait(plain(RED, (320, 200)), width=320, height=200)
    assert shown.canvas.evaluate("(canvas) => [canvas.width, canvas.height]") == [320, 200]
    assert shown.colour_at(0, 0) == shown.colour_at(319, 199) == RED
    log = shown.page.evaluate("volsplatViewport.log.at(-1)")
    assert (log["number"], log["event"], log["step"]) == (number, 0, "F")
    assert 0 < log["shownAt"] <= shown.page.evaluate("performance.now()")


def test_an_older_picture_is_dropped_and_acknowledged(shown: ShownViewport) -> None:
    shown.show_and_wait(plain(RED), number=7)
    shown.show_and_wait(plain(GREEN), number=5)
    assert shown.colour_at(0, 0) == RED
    assert shown.shown_numbers() == [1, 7]


def test_a_picture_that_is_quicker_to_decode_is_not_overtaken(shown: ShownViewport) -> None:
    for number in range(2, 32, 2):
        shown.process.show(plain(RED, (3000, 2000)), number=number, width=3000, height=2000)
        shown.process.show(plain(GREEN, (8, 8)), number=number + 1, width=8, height=8)
    shown.process.wait_for("shown", 30)
    numbers = shown.shown_numbers()
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == 31
    assert sorted(said["number"] for said in shown.process.heard_of("shown")) == list(range(2, 32))


def test_the_page_never_blinks_between_pictures(shown: ShownViewport) -> None:
    shown.show_and_wait(plain(RED))
    shown.page.evaluate(
        """() => {
            const canvas = document.querySelector("canvas");
            window.seen = new Set();
            const look = () => {
                window.seen.add([...canvas.getContext("2d").getImageData(0, 0, 1, 1).data].join());
                requestAnimationFrame(look);
            };
            look();
        }"""
    )
    for n in range(20):
        size = (400 + n, 300)
        shown.show_and_wait(plain(RED, size), width=size[0], height=size[1])
    assert shown.page.evaluate("[...window.seen]") == ["200,0,0,255"]


def test_a_damaged_picture_is_told_of_and_acknowledged(shown: ShownViewport) -> None:
    shown.show_and_wait(plain(RED))
    for last, cure in ((False, "a newer one will replace it"), (True, "move the view to have it drawn again")):
        shown.show_and_wait(b"no picture", last=last)
        expect(shown.page.get_by_role("status")).to_contain_text(f"arrived damaged; {cure}")
    assert shown.colour_at(0, 0) == RED


def test_on_a_screen_of_finer_pixels_more_of_them_are_asked_for(shown: ShownViewport) -> None:
    with on_finer_screen(shown.page):
        size = shown.process.wait_for("size")
    assert (size["width"], size["height"]) == (2 * SIZE[0], 2 * SIZE[1])


def test_the_size_of_the_element_is_asked_for_once_it_rests(shown: ShownViewport) -> None:
    shown.page.evaluate(  # it rests once the page has its timers again, however slow the machine is
        """async () => {
            const own = [window.setTimeout, window.clearTimeout], held = new Map();
            window.setTimeout = (...what) => held.set(-held.size - 1, what).size * -1;
            window.clearTimeout = (timer) => held.has(timer) ? held.set(timer, null) : own[1].call(window, timer);
            for (const width of [500, 450, 400]) {
                document.querySelector("#host").style.width = `${width}px`;
                for (let n = 0; n < 2; n++) await new Promise(requestAnimationFrame);
            }
            [window.setTimeout, window.clearTimeout] = own;
            for (const what of held.values()) if (what) window.setTimeout(...what);
        }"""
    )
    said = shown.process.wait_for("size")
    assert (said["width"], said["height"]) == (400, SIZE[1])
    shown.show_and_wait()
    assert len(shown.process.heard_of("size")) == 1


def test_a_picture_of_another_shape_lies_in_the_middle(shown: ShownViewport) -> None:
    """Two tabs share a scene, and so the picture's size: here it is half as wide as this tab's window."""
    shown.process.say_scene(size=(160, 240))
    shown.show_and_wait(plain(RED, (160, 240)), width=160, height=240)
    shown.page.mouse.click(160 + 2 * 30, 2 * 50)
    center = shown.process.wait_for("center")
    assert (center["x"], center["y"]) == pytest.approx((29.5, 49.5))


def test_a_dense_display_gets_a_picture_of_its_own_pixels(browser: Browser) -> None:
    process = ViewportProcess()
    with serving(process.application) as url, patient_context(browser, device_scale_factor=2) as context:
        shown = ShownViewport(context.new_page(), process, url)
        shown.page.reload()
        size = process.wait_for("size")
        assert (size["width"], size["height"]) == (2 * SIZE[0], 2 * SIZE[1])
        process.say(VOLUME)
        process.say_scene(size=(2 * SIZE[0], 2 * SIZE[1]))
        shown.show_and_wait(plain(RED, (2 * SIZE[0], 2 * SIZE[1])), width=2 * SIZE[0], height=2 * SIZE[1])
        shown.page.mouse.click(200, 100)
        center = process.wait_for("center")
        assert (center["x"], center["y"]) == (399.5, 199.5)


# -- the marks over a picture


def handle(shown: ShownViewport, face: str) -> Locator:
    return shown.page.locator(f'[data-face="{face}"]')


def place_of(mark: Locator) -> tuple[float, float]:
    box = mark.bounding_box()
    assert box is not None
    return (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_handles_lie_on_the_faces_of_the_picture_shown(shown: ShownViewport) -> None:
    shown.process.say_scene(bounds={"low": [10, 0, 0], "high": VOLUME["dims"]})
    shown.show_and_wait()
    left, right = place_of(handle(shown, "low-i")), place_of(handle(shown, "high-i"))
    middle = MIDDLE[0] + 0.5
    assert left[0] == pytest.approx(middle + (9.5 - 31.5) * PIXELS_PER_VOXEL, abs=HALF_A_CSS_PIXEL)
    assert right[0] == pytest.approx(middle + (63.5 - 31.5) * PIXELS_PER_VOXEL, abs=HALF_A_CSS_PIXEL)
    # j runs away from the viewer: its faces cannot be dragged here.
    expect(handle(shown, "low-j")).to_be_hidden()
    expect(handle(shown, "high-k")).to_be_visible()


def test_dragging_a_handle_cuts_whole_voxels(shown: ShownViewport) -> None:
    x, y = place_of(handle(shown, "low-i"))
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 9.8 * PIXELS_PER_VOXEL, y + 30, steps=4)
    expect(shown.page.get_by_text("lowest i = 10")).to_be_visible()
    shown.page.mouse.up()
    last = shown.process.wait_for_settled("bounds")
    assert (last["low"], last["high"]) == ([10, 0, 0], VOLUME["dims"])
    assert not any(said["settled"] for said in shown.process.heard_of("bounds")[:-1])
    assert shown.process.heard_of("view") == shown.process.heard_of("center") == []


@pytest.mark.parametrize(
    ("face", "voxels", "expected"),
    [
        ("low-i", 100, {"low": [63, 0, 0], "high": [64, 48, 40]}),
        ("high-i", -100, {"low": [0, 0, 0], "high": [1, 48, 40]}),
        ("high-i", 20, None),
    ],
)
def test_a_handle_stops_at_the_volume_and_at_its_partner(
    shown: ShownViewport, face: str, voxels: int, expected: dict[str, list[int]] | None
) -> None:
    x, y = place_of(handle(shown, face))
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + voxels * PIXELS_PER_VOXEL, y)
    shown.page.mouse.up()
    shown.show_and_wait()
    if expected is None:
        assert shown.process.heard_of("bounds") == []
    else:
        said = shown.process.wait_for_settled("bounds")
        assert {"low": said["low"], "high": said["high"]} == expected


@pytest.mark.parametrize("with_shift", [False, True])
def test_a_drag_leaves_what_another_tab_does_to_other_faces(shown: ShownViewport, with_shift: bool) -> None:
    _, j, k = VOLUME["dims"]
    shown.process.say_scene(bounds={"low": [0, 0, 0], "high": [20, j, k]})
    shown.show_and_wait()
    x, y = place_of(handle(shown, "low-i"))
    _, top = place_of(handle(shown, "high-k"))
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    if with_shift:
        shown.page.keyboard.down("Shift")
    shown.page.mouse.move(x + 10 * PIXELS_PER_VOXEL, y, steps=4)
    shown.process.wait_for("bounds")
    shown.process.say_scene(by="t2", settled=False, bounds={"low": [0, 0, 0], "high": [20, j, k - 5]})
    shown.show_and_wait()
    expect(shown.page.get_by_text("lowest i = 10")).to_be_visible()
    assert place_of(handle(shown, "low-i"))[0] == pytest.approx(x + 10 * PIXELS_PER_VOXEL, abs=HALF_A_CSS_PIXEL)
    moved = abs(place_of(handle(shown, "high-k"))[1] - top)
    assert moved == pytest.approx(5 * 2 * PIXELS_PER_VOXEL, abs=HALF_A_CSS_PIXEL)
    shown.process.forget()
    shown.page.mouse.move(x + 12 * PIXELS_PER_VOXEL, y, steps=2)
    shown.page.mouse.up()
    shown.page.keyboard.up("Shift")
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"], said["high"]) == ([12, 0, 0], [32 if with_shift else 20, j, k - 5])


def test_a_dragged_face_stops_at_its_partner_where_another_tab_puts_it(shown: ShownViewport) -> None:
    _, j, k = VOLUME["dims"]
    x, y = place_of(handle(shown, "low-i"))
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 10 * PIXELS_PER_VOXEL, y, steps=4)
    shown.process.wait_for("bounds")
    shown.process.say_scene(by="t2", bounds={"low": [0, 0, 0], "high": [5, j, k]})
    shown.show_and_wait()
    expect(shown.page.get_by_text("lowest i = 4")).to_be_visible()
    shown.page.mouse.move(x + 2 * PIXELS_PER_VOXEL, y)
    expect(shown.page.get_by_text("lowest i = 2")).to_be_visible()
    shown.page.mouse.move(x + 9 * PIXELS_PER_VOXEL, y)
    shown.page.mouse.up()
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"], said["high"]) == ([4, 0, 0], [5, j, k])


@pytest.mark.parametrize(("voxels", "expected"), [(5, (15, 25)), (100, (54, 64)), (-100, (0, 10))])
def test_a_handle_moves_the_whole_slab_with_shift(shown: ShownViewport, voxels: int, expected: tuple[int, int]) -> None:
    shown.process.say_scene(bounds={"low": [10, 0, 0], "high": [20, *VOLUME["dims"][1:]]})
    shown.show_and_wait()
    x, y = place_of(handle(shown, "low-i"))
    shown.page.mouse.move(x, y)
    shown.page.keyboard.down("Shift")
    shown.page.mouse.down()
    shown.page.mouse.move(x + voxels * PIXELS_PER_VOXEL, y, steps=3)
    shown.page.mouse.up()
    shown.page.keyboard.up("Shift")
    said = shown.process.wait_for_settled("bounds")
    assert (said["low"][0], said["high"][0]) == expected
    assert shown.process.heard_of("view") == []


def test_the_box_shows_while_the_pointer_is_over_the_viewport(shown: ShownViewport) -> None:
    for part in (".vs-edges", ".vs-handles"):
        shown.page.mouse.move(SIZE[0] + 100, SIZE[1] + 100)
        expect(shown.page.locator(part)).to_have_css("opacity", "0")
        shown.page.mouse.move(300, 200)
        expect(shown.page.locator(part)).to_have_css("opacity", "1")


def test_the_edges_of_the_box_lie_where_the_picture_has_them(shown: ShownViewport) -> None:
    """The front face's corners, and nothing of the canvas but what is near a line."""
    shown.process.say_scene(bounds={"low": [10, 0, 0], "high": VOLUME["dims"]})
    shown.show_and_wait()
    x = [MIDDLE[0] + 0.5 + (i - 31.5) * PIXELS_PER_VOXEL for i in (9.5, 63.5)]
    y = [MIDDLE[1] + 0.5 + (k - 19.5) * 2 * PIXELS_PER_VOXEL for k in (-0.5, 39.5)]
    drawn = drawn_pixels(shown.page.locator(".vs-edges"))
    columns, rows = [math.floor(u) for u in x], [math.floor(v) for v in y]
    assert drawn[np.ix_(rows, columns)].all(), "no line at a corner"
    off = np.ones_like(drawn)
    for column in columns:
        off[:, column - 1 : column + 2] = False
    for row in rows:
        off[row - 1 : row + 2] = False
    assert not (drawn & off).any()


def test_handles_are_away_while_the_view_moves_and_back_when_it_rests(shown: ShownViewport) -> None:
    expect(handle(shown, "high-k")).to_be_visible()
    shown.page.mouse.move(300, 200)
    shown.page.mouse.down()
    expect(handle(shown, "high-k")).to_be_visible()
    shown.page.mouse.move(340, 210, steps=3)
    shown.show_and_wait(view=OBLIQUE)
    expect(handle(shown, "high-k")).to_be_hidden()
    shown.page.mouse.up()
    expect(handle(shown, "high-k")).to_be_visible()


def test_boxes_of_what_is_missing_are_drawn(shown: ShownViewport) -> None:
    lines = shown.page.locator(".vs-missing line")
    shown.show_and_wait(missing=[[[0, 0, 0], [32, 48, 40]]])
    expect(lines).to_have_count(12)
    shown.show_and_wait()
    expect(lines).to_have_count(0)


def test_parts_of_the_picture_that_nobody_has_drawn_are_outlined(shown: ShownViewport) -> None:
    parts = shown.page.locator(".vs-undrawn rect")
    shown.show_and_wait(undrawn=[[0, 0, 100, 60]])
    expect(parts).to_have_count(1)
    shown.show_and_wait()
    expect(parts).to_have_count(0)


def test_the_cube_stands_as_the_picture_and_turns_to_a_side(shown: ShownViewport) -> None:
    assert sides_of_cube(shown).keys() == {"front"}
    shown.process.say_scene(by="t2", view=OBLIQUE)
    shown.show_and_wait(view=OBLIQUE)
    sides = sides_of_cube(shown, OBLIQUE)
    assert sides.keys() == {"front", "left", "top"}
    shown.page.mouse.click(*sides["left"])
    view = shown.process.wait_for_settled()
    assert view["rotation"] == pytest.approx(named_view("left"), abs=CAMERA_PIXELS)
    # The picture on the screen is still the old one, and so is the cube over it.
    assert sides_of_cube(shown, OBLIQUE) == sides


def test_a_side_of_the_cube_under_the_pointer_is_marked(shown: ShownViewport) -> None:
    cube = shown.page.locator(".vs-cube")
    rests = cube.screenshot()
    shown.page.mouse.move(*sides_of_cube(shown)["front"])
    expect(cube).to_have_attribute("title", "look from the front (A)")
    expect(cube).to_have_css("cursor", "pointer")
    assert cube.screenshot() != rests
    shown.page.mouse.move(0, 0)
    expect(cube).to_have_attribute("title", "")
    assert cube.screenshot() == rests


def test_the_cube_of_other_volumes_names_the_axes(shown: ShownViewport) -> None:
    cube = shown.page.locator(".vs-cube")
    as_patient = cube.screenshot()
    shown.process.say({**VOLUME, "sides": {**VOLUME["sides"], "front": "−y"}})
    shown.show_and_wait()
    assert cube.screenshot() != as_patient, "the letter is still A"
    shown.process.say(VOLUME)
    shown.show_and_wait()
    assert cube.screenshot() == as_patient


def test_the_cube_is_drawn_in_the_theme_that_the_page_has_taken(shown: ShownViewport) -> None:
    cube = shown.page.locator(".vs-cube")
    light = cube.screenshot()
    shown.page.evaluate("document.body.classList.add('body--dark')")
    shown.frames(2)
    assert cube.screenshot() != light
    shown.page.evaluate("document.body.classList.remove('body--dark')")
    shown.frames(2)
    assert cube.screenshot() == light


@pytest.mark.parametrize("view", [*VIEW_NAMES, "rolled 90", "rolled 180", "rolled -30", "oblique", "overturned"])
def test_the_letters_of_the_cube_stand_upright(shown: ShownViewport, view: str) -> None:
    """Of the four ways that a letter can lie on its face, the one nearest upright on the screen is taken."""
    for a, b, c, d, _, _ in standing(shown, rotation_called(view)).values():
        assert a * d - b * c > 0, "a letter is mirrored"
        chosen, *others = (y / math.hypot(x, y) for x, y in ((c, d), (a, b), (-c, -d), (-a, -b)))
        assert chosen >= max(others)
        if view in VIEW_NAMES:
            assert (c, d) == pytest.approx((0, abs(a)), abs=HALF_A_CSS_PIXEL)


def sides_of_cube(shown: ShownViewport, view: Message = VIEW) -> dict[str, tuple[float, float]]:
    """The sides that are seen in a view, as the pointer finds them, and where their middles are."""
    cube = shown.page.locator(".vs-cube")
    box = cube.bounding_box()
    assert box is not None
    found = {}
    for side, matrix in standing(shown, view["rotation"], box["width"]).items():
        middle = box["x"] + matrix[4], box["y"] + matrix[5]
        shown.page.mouse.move(*middle)
        expect(cube).to_have_attribute("title", f"look from the {side} ({VOLUME['sides'][side]})")
        found[side] = middle
    return found


def standing(shown: ShownViewport, rotation: Sequence[float], room: float = 100) -> dict[str, list[float]]:
    """By view, how the cube's sides that are seen lie in its room."""
    sides: list[tuple[str, list[float]]] = shown.page.evaluate(
        """async ([rotation, room]) => {
            const { standing } = await import("/static/viewport/orientation_cube.js");
            return standing(rotation, room).map(({ view, matrix }) => [view, matrix]);
        }""",
        [rotation, room],
    )
    assert sides
    return dict(sides)


def test_scale_bars_are_drawn_a_few_times_a_second_while_the_view_moves_and_at_once_at_rest(
    shown: ShownViewport,
) -> None:
    told: list[str] = shown.page.evaluate(
        """async () => {
            const { ScaleBars } = await import("/static/viewport/scale_bar.js");
            const scales = [{ axis: null, name: "", length: 1, unit: "mm" }];
            const bars = new ScaleBars({ reference_spacing: 1, scales });
            const now = performance.now;
            const at = (clock, zoom, moving) => {
                performance.now = () => clock;
                bars.draw(zoom, 512, null, moving);
                return bars.element.textContent;
            };
            const told = [at(0, 1, true), at(40, 2, true), at(300, 2, true), at(340, 4, true), at(341, 4, false)];
            told.push(at(700, 8, true), at(740, 16, true));
            performance.now = now;
            while (bars.element.textContent === told.at(-1)) await new Promise((resolve) => setTimeout(resolve));
            return [...told, bars.element.textContent];
        }"""
    )
    assert told == ["100 mm", "100 mm", "50 mm", "50 mm", "20 mm", "10 mm", "10 mm", "5 mm"], "the last comes by itself"


def drawn_pixels(canvas: Locator) -> NDArray[np.bool_]:
    """(rows, columns): whether something is drawn there."""
    alphas: list[int] = canvas.evaluate(
        """(canvas) => {
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return Array.from({ length: data.length / 4 }, (_, n) => data[4 * n + 3]);
        }"""
    )
    width = canvas.evaluate("(canvas) => canvas.width")
    return (np.array(alphas) > 0).reshape(-1, width)


def rotation_called(view: str) -> Quaternion:
    name, _, degrees = view.partition(" ")
    if name == "rolled":
        return product(about(2, float(degrees)), named_view("front"))
    if view == "overturned":
        return product(about(2, 180), OBLIQUE["rotation"])
    return OBLIQUE["rotation"] if view == "oblique" else named_view(view)


EXACT = {"density_is": "", "strength_is": ""}  # of a told value
REFERENCE = VOLUME["reference_spacing"]
SCALES = [
    {"name": "RA, Dec", "unit": "arcmin", "length": 1.0, "axis": None},
    {"name": "velocity", "unit": "km/s", "length": 0.25, "axis": None},
]


def test_each_scale_has_a_bar_of_a_round_length(shown: ShownViewport) -> None:
    shown.process.say({**VOLUME, "scales": SCALES})
    shown.show_and_wait()
    expect(shown.page.locator(".vs-scale")).to_have_text(["RA, Dec 20 arcmin", "velocity 100 km/s"])
    widths = shown.page.locator(".vs-scale-bar").evaluate_all(
        "(bars) => bars.map((b) => b.getBoundingClientRect().width)"
    )
    expected = [length * VIEW["zoom"] / REFERENCE for length in (20, 25)]
    assert widths == pytest.approx(expected, abs=HALF_A_CSS_PIXEL)


def test_a_bar_for_one_axis_is_as_long_as_that_lies_on_the_screen_and_there_is_none_along_the_line_of_sight(
    shown: ShownViewport,
) -> None:
    shown.process.say({**VOLUME, "scales": [SCALES[0], {**SCALES[1], "axis": 2}]})
    bar = shown.page.locator(".vs-scale:visible", has_text="velocity")
    shown.show_and_wait(view={**VIEW, "rotation": named_view("top")})
    expect(bar).to_have_count(0)
    shown.show_and_wait(view=OBLIQUE)
    expect(bar).to_have_count(1)
    told = float(bar.inner_text().split()[1])
    box = bar.locator(".vs-scale-bar").bounding_box()
    assert box is not None
    across = math.cos(math.radians(25))  # of the upright axis, at this elevation
    assert box["width"] == pytest.approx(told * 0.25 * across * VIEW["zoom"] / REFERENCE, abs=HALF_A_CSS_PIXEL)


def test_a_resting_pointer_asks_for_the_value_under_it(shown: ShownViewport) -> None:
    value = shown.page.locator(".vs-value")
    shown.page.mouse.move(200, 150)
    asked = shown.process.wait_for_probe()
    assert (asked["x"], asked["y"]) == (199.5, 149.5)
    answer = {**asked, **EXACT}
    elsewhere = {"index": [1, 2, 3], "density": 5.0, "strength": 6.0}
    shown.process.say({**answer, "x": 1.0, "found": elsewhere})
    found = {"index": [48, 60, 20], "density": 1124.0, "strength": 31.21}
    shown.process.say({**answer, "found": found})
    expect(value).to_have_text("density 1124 · gradient strength 31.2 at (48, 60, 20)")
    shown.process.say({**answer, "found": found, "density_is": "≥", "strength_is": "≈"})
    expect(value).to_have_text("density ≥1124 · gradient strength ≈31.2 at (48, 60, 20)")
    own = {"type": "value", "x": asked["x"], "y": asked["y"], "density": "1123.6875", "strength": None}
    shown.process.say({**own, "x": 1.0, "density": "5"})
    shown.process.say(own)
    expect(value).to_have_text("density 1123.6875 · gradient strength ≈31.2 at (48, 60, 20)")
    shown.process.say({**own, "strength": "45.5"})
    expect(value).to_have_text("density 1123.6875 · gradient strength 45.5 at (48, 60, 20)")
    shown.process.say({**answer, "found": None})
    expect(value).to_be_hidden()
    shown.process.say(own)
    expect(value).to_be_hidden()


def test_a_value_is_told_in_its_unit_and_at_what_its_indices_stand_for(shown: ShownViewport) -> None:
    axes = [
        {"name": "time", "unit": "ms", "first": 4.0, "step": 4.0},
        {"name": "crossline", "unit": "", "first": 875.0, "step": 1.0},
        {"name": "RA", "unit": "deg", "first": 309.07, "step": -0.00716},
    ]
    shown.process.say({**VOLUME, "value_unit": "mV", "axes": axes})
    shown.show_and_wait()
    shown.page.mouse.move(200, 150)
    asked = shown.process.wait_for_probe()
    found = {"index": [9, 5, 2], "density": -3.5, "strength": 31.21}
    shown.process.say({**asked, **EXACT, "found": found})
    expect(shown.page.locator(".vs-value")).to_have_text(
        "density -3.5 mV · gradient strength 31.2 at time 40 ms, crossline 880, RA 309.0557 deg"
    )


def test_the_document_hears_of_the_value_until_the_pointer_leaves(shown: ShownViewport) -> None:
    shown.page.evaluate(
        """() => {
            window.told = [];
            document.addEventListener("volsplat-value", (event) => window.told.push(event.detail));
        }"""
    )
    shown.page.mouse.move(200, 150)
    asked = shown.process.wait_for_probe()
    shown.process.say({**asked, **EXACT, "found": {"index": [48, 60, 20], "density": 1124.2, "strength": 31.21}})
    shown.page.locator(".vs-value").wait_for()
    value = {"density": 1124.2, "strength": 31.21, "grid-i": 48, "grid-j": 60, "grid-k": 20}
    assert shown.page.evaluate("window.told") == [value]
    shown.page.mouse.move(SIZE[0] + 100, SIZE[1] + 100, steps=5)
    assert shown.page.evaluate("window.told") == [value, None]


def test_no_value_is_asked_for_while_things_move(shown: ShownViewport) -> None:
    shown.page.mouse.move(200, 150)
    shown.page.mouse.down()
    shown.page.mouse.move(260, 150)
    shown.process.wait_for("view")
    shown.process.forget()
    shown.frames(10)
    shown.show_and_wait(revision=2)
    assert shown.process.heard_of("probe") == []


def test_a_value_is_asked_for_anew_when_the_picture_has_changed(shown: ShownViewport) -> None:
    value = shown.page.locator(".vs-value")
    shown.page.mouse.move(200, 150)
    asked = shown.process.wait_for_probe()
    shown.process.say({**asked, **EXACT, "found": {"index": [48, 60, 20], "density": 1124.2, "strength": 31.21}})
    value.wait_for()
    shown.show_and_wait(revision=2, last=False)
    expect(value).to_be_hidden()
    shown.show_and_wait(revision=2, last=True)
    assert shown.process.wait_for_probe(2) == asked


# -- troubles


def test_a_trouble_is_told_until_it_is_over(shown: ShownViewport) -> None:
    status = shown.page.get_by_role("status")
    expect(status).to_be_hidden()
    shown.process.say({"type": "trouble", "text": "The server b.lan was lost.", "lasting": True})
    expect(status).to_have_text("The server b.lan was lost.")
    shown.process.say({"type": "trouble", "text": "", "lasting": True})
    expect(status).to_be_hidden()


def test_a_trouble_that_lasts_is_told_again_once_another_one_has_passed(shown: ShownViewport) -> None:
    status = shown.page.get_by_role("status")
    for text in ("The server b.lan was lost.", "The volume has no such bounds.", ""):
        shown.process.say({"type": "trouble", "text": text, "lasting": text.startswith("The server")})
        expect(status).to_have_text(text or "The server b.lan was lost.")
    shown.process.say({"type": "trouble", "text": "", "lasting": True})
    expect(status).to_be_hidden()


def test_after_a_drop_the_page_connects_again(shown: ShownViewport) -> None:
    shown.show_and_wait(plain(RED))
    shown.process.hang_up()
    assert shown.process.wait_for("size")["again"], "nobody resized anything"
    assert shown.colour_at(0, 0) == RED
    shown.process.say(VOLUME)
    shown.process.say_scene(view=OBLIQUE)
    shown.show_and_wait(plain(GREEN), view=OBLIQUE)
    assert shown.colour_at(0, 0) == GREEN
    shown.canvas.focus()
    shown.page.keyboard.press("+")
    assert shown.process.wait_for("view")["rotation"] == pytest.approx(list(OBLIQUE["rotation"]))


def test_a_process_that_is_away_is_told_of_and_found_again(browser_page: Page) -> None:
    first = ViewportProcess()
    with serving(first.application) as url:
        shown = ShownViewport(browser_page, first, url)
        shown.show_and_wait(plain(RED), number=1000)
        first.hang_up()
    status = browser_page.get_by_role("status")
    expect(status).to_contain_text("No connection to volsplat's process")
    assert shown.colour_at(0, 0) == RED
    shown.canvas.focus()
    browser_page.keyboard.press("+")
    browser_page.wait_for_function("() => !window.volsplatViewport.steering.busy")
    second = ViewportProcess()
    with serving(second.application, port=urlsplit(url).port or 0):
        second.wait_for_page()
        expect(status).to_be_hidden()
        said = second.wait_for("view")  # what was done while nobody heard it
        assert said["zoom"] == pytest.approx(1.25 * VIEW["zoom"])
        second.say(VOLUME)
        second.say_scene()
        shown.process = second
        shown.show_and_wait(plain(GREEN), event=said["event"])  # numbers begin anew
        assert shown.colour_at(0, 0) == GREEN
        browser_page.keyboard.press("ArrowUp")
        assert second.wait_for("view", 2)["zoom"] == VIEW["zoom"]


def test_a_page_that_another_process_does_not_know_is_told_so_until_it_does(browser_page: Page) -> None:
    first, second = ViewportProcess(), ViewportProcess()
    with serving(first.application) as url:
        ShownViewport(browser_page, first, url).show_and_wait(plain(RED))
        first.hang_up()
    second.refuses = True
    with serving(second.application, port=urlsplit(url).port or 0):
        status = browser_page.get_by_role("status")
        expect(status).to_contain_text("This page may no longer see the volume: open the whole address")
        second.refuses = False
        second.wait_for_page()
        expect(status).to_be_hidden()


def test_a_picture_with_nothing_on_it_is_told_of_until_there_is_something(shown: ShownViewport) -> None:
    bar = shown.page.locator(".vs-trouble")
    shown.show_and_wait(notice="nothing is visible: the opacity table is 0 everywhere; raise it")
    expect(bar).to_have_text("nothing is visible: the opacity table is 0 everywhere; raise it")
    shown.show_and_wait()
    expect(bar).to_be_hidden()
