"""The panels in a real browser: each control as a person uses it changes the scene as it says."""

from __future__ import annotations

import math
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import psutil
import pytest
import torch

from support.checkout import ROOT
from support.files.prepared import prepare_small
from support.pages.browser import KeptPage, browser, browser_page, kept_page, no_failures, patient_context
from support.pages.held_answers import HeldAnswers
from support.pages.panels_page import State
from support.patience import PATIENCE
from support.programs.server_processes import is_server
from tolerances import BALL_DIRECTION, ROTATION_ENTRY
from volsplat.client.phantoms.make_phantom import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.controls.text_field import shown_number
from volsplat.client.ui.panels.light_controls import screen_direction
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Bounds, Kernel, Order, Scene
from volsplat.protocol.description.scene_keys import KEYS, TABLE_WORDS
from volsplat.protocol.description.shading_tables import Field
from volsplat.protocol.description.view_rotation import VIEW_NAMES, named_view
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.refinement import PAPER_STEPS

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

__all__ = ["browser", "browser_page", "kept_page"]

PROGRAM = "support.pages.panels_page"
DIMS = (24, 20, 16)
REACH = 0.06  # of the ball's radius, within which a pointer hits


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "shells.nrrd"
    write_volume(path, *make_phantom("shells", size=DIMS))
    return path


@contextmanager
def served(volume: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """The panels' address, and the program that serves them."""
    command = [sys.executable, "-m", PROGRAM, str(volume)]
    program = subprocess.Popen(command, cwd=ROOT / "tests", stdout=subprocess.PIPE, encoding="utf-8")
    try:
        assert program.stdout is not None
        yield program.stdout.readline().strip(), program
    finally:
        program.terminate()
        program.wait()
        assert program.stdout is not None
        program.stdout.close()


@pytest.fixture(scope="module")
def url(volume: Path) -> Iterator[str]:
    with served(volume) as (address, _):
        yield address


class Tab:
    """A tab on the panels, and the scene behind it."""

    def __init__(self, page: Page, url: str) -> None:
        self.page = page
        self.url = url

    def load(self) -> Tab:
        self.page.goto(self.url)
        self.page.wait_for_selector(".vs-light-ball")
        self.page.wait_for_function("() => window.did_handshake")
        return self

    @property
    def state(self) -> State:
        return msgspec.json.decode(self.page.request.get(f"{self.url}/state").body(), type=State)

    @property
    def scene(self) -> Scene:
        return self.state.scene

    def until(self, holds: Callable[[State], bool]) -> Scene:
        """The scene, as soon as it is so and settled."""
        for _ in range(int(50 * PATIENCE)):
            state = self.state
            if state.settled and holds(state):
                return state.scene
            self.page.wait_for_timeout(20)
        raise AssertionError(f"the scene did not become what it was to be: {self.scene}")

    def becomes(self, get: Callable[[Scene], object], value: object) -> Scene:
        return self.until(lambda state: get(state.scene) == value)

    def leaves(self, get: Callable[[Scene], object], value: object) -> Scene:
        return self.until(lambda state: get(state.scene) != value)

    def field(self, name: str) -> Locator:
        return self.page.get_by_label(name, exact=True)

    def shows(self, element: Locator, attribute: str, value: str) -> None:
        """Wait until the page has followed the scene."""
        from playwright.sync_api import expect

        expect(element).to_have_attribute(attribute, value)

    def holds(self, name: str, text: str) -> None:
        """Wait until a field shows this."""
        from playwright.sync_api import expect

        expect(self.field(name)).to_have_value(text)

    def types(self, name: str, text: str) -> None:
        self.field(name).fill(text)
        self.field(name).press("Enter")

    def complaint(self, name: str) -> Locator:
        return self.page.locator(".q-field", has=self.field(name)).get_by_role("alert")

    def button(self, name: str, panel: str) -> Locator:
        return self.page.get_by_role("region", name=panel).get_by_role("button", name=name, exact=True)

    def choice(self, name: str, of: str) -> Locator:
        """A button of those that stand beside the words `of`."""
        return self.page.locator(f'[aria-label="{of}"]').get_by_role("button", name=name, exact=True)

    def drag(self, from_: tuple[float, float], to: tuple[float, float]) -> None:
        self.page.mouse.move(*from_)
        self.page.mouse.down()
        self.page.mouse.move(*to, steps=6)
        self.page.mouse.up()


@pytest.fixture
def tab(kept_page: KeptPage, url: str, request: pytest.FixtureRequest) -> Iterator[Tab]:
    """A tab that shows the scene as it was at the beginning."""
    page, empty = kept_page.page(request.node.nodeid)
    tab = Tab(page, url)
    with no_failures(page):
        if empty:
            tab.load()
        revision = int(page.request.get(f"{url}/again").text())  # a late event of the test before may raise it
        page.wait_for_function(
            "(least) => Number(document.querySelector('[data-revision]')?.textContent) >= least", arg=revision
        )
        yield tab


# -- shading


def test_one_click_wires_a_table_to_a_field(tab: Tab) -> None:
    for table, field in (("opac", Field.GRID_K), ("emit", Field.SCREEN_Z), ("modu", Field.DENSITY)):
        called = "value" if field is Field.DENSITY else field.value.replace("-", " ")  # of no kind that is told
        wire = tab.page.get_by_role("radio", name=f"{TABLE_WORDS[table]} by {called}")
        before = tab.scene.cross_bar
        wire.click()
        after = tab.becomes(attrgetter(f"cross_bar.{table}"), field).cross_bar
        assert after == msgspec.structs.replace(before, **{table: field})
        assert wire.is_checked()


def test_arrow_keys_move_a_wire_along_its_row(tab: Tab) -> None:
    tab.page.get_by_role("radio", name="Reflected by value").focus()
    tab.page.keyboard.press("ArrowRight")
    tab.becomes(lambda scene: scene.cross_bar.refl, Field.STRENGTH)


def test_a_switch_turns_a_part_of_the_shading_on_and_off(tab: Tab) -> None:
    for part in ("emitted", "diffuse", "specular", "modulation", "two-sided"):
        shading = attrgetter(f"shading.{part.replace('-', '_')}")
        before = shading(tab.scene)
        switch = tab.page.get_by_role("switch", name=part, exact=True)
        for value in (not before, before):
            switch.click()
            tab.becomes(shading, value)
            tab.shows(switch, "aria-checked", str(value).lower())


def test_the_specular_power_is_typed_or_slid(tab: Tab) -> None:
    tab.types("specular power, a number", "100")
    tab.becomes(lambda scene: scene.shading.specular_power, 100.0)
    slider = tab.page.get_by_role("slider", name="specular power")
    tab.shows(slider, "aria-valuenow", "100")
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    tab.drag((box["x"] + box["width"] * 2 / 3, middle), (box["x"] + box["width"] + 20, middle))
    tab.becomes(lambda scene: scene.shading.specular_power, 1000.0)
    assert "shading" in tab.state.unsettled
    tab.holds("specular power, a number", "1000")


def on_ball(tab: Tab, x: float, y: float) -> tuple[float, float]:
    """The pixel at x and y in the ball's radii from its middle, y up."""
    box = tab.page.locator(".vs-light-ball").bounding_box()
    assert box is not None
    radius = box["width"] / 2 - 8
    return (box["x"] + box["width"] / 2 + x * radius, box["y"] + box["height"] / 2 - y * radius)


def test_the_light_is_dragged_on_the_ball_and_past_its_rim(tab: Tab) -> None:
    tab.drag(on_ball(tab, 0, 0), on_ball(tab, 0.6, 0))
    scene = tab.until(lambda state: state.scene.light.direction[0] > 0.5)
    assert scene.light.direction == pytest.approx((0.6, 0, 0.8), abs=REACH)
    assert "shading" in tab.state.unsettled
    tab.drag(on_ball(tab, 0.6, 0), on_ball(tab, 1.4, 0))
    scene = tab.until(lambda state: state.scene.light.direction[2] < 0)
    assert scene.light.direction == pytest.approx((0.6, 0, -0.8), abs=REACH)
    tab.button("bring it in front", "shading").click()
    scene = tab.until(lambda state: state.scene.light.direction[2] > 0)
    assert scene.light.direction == pytest.approx((0.6, 0, 0.8), abs=REACH)
    tab.button("put it behind", "shading").wait_for()
    tab.page.locator(".vs-light-ball").focus()
    tab.page.keyboard.press("ArrowUp")
    tab.until(lambda state: state.scene.light.direction[1] > 0.05)


def test_the_light_does_not_jump_back_where_the_server_answers_late(browser_page: Page, url: str) -> None:
    answers = HeldAnswers(browser_page)
    assert browser_page.request.get(f"{url}/again").ok
    tab = Tab(browser_page, url).load()
    at_first = angle_to_the_right(tab.scene)

    def turned(by: float) -> Scene:
        expected = pytest.approx(at_first + by, abs=BALL_DIRECTION)
        return tab.until(lambda state: angle_to_the_right(state.scene) == expected)

    tab.page.locator(".vs-light-ball").focus()
    answers.press_ahead("ArrowRight", lambda: turned(0.1))
    turned(0.4)


def angle_to_the_right(scene: Scene) -> float:
    """Of the light, radians from the middle of the screen."""
    x, _, z = screen_direction(scene)
    return math.atan2(x, z)


def test_fixing_the_light_to_the_grid_leaves_it_where_it_is(tab: Tab) -> None:
    tab.button("left", "view").click()
    before = tab.becomes(lambda scene: scene.view.rotation, named_view("left"))
    tab.button("grid", "shading").click()
    fixed = tab.becomes(lambda scene: scene.light.fixed_to, "grid")
    assert screen_direction(fixed) == pytest.approx(screen_direction(before), abs=ROTATION_ENTRY)
    assert fixed.light.direction != pytest.approx(before.light.direction, abs=ROTATION_ENTRY)
    tab.button("top", "view").click()
    turned = tab.becomes(lambda scene: scene.view.rotation, named_view("top"))
    assert turned.light == fixed.light  # it turned with the volume
    tab.button("world", "shading").click()
    world = tab.becomes(lambda scene: scene.light.fixed_to, "world")
    assert world.light.direction == pytest.approx(screen_direction(turned), abs=ROTATION_ENTRY)


# -- view and bounds


def test_a_side_is_seen_at_one_click(tab: Tab) -> None:
    for side in VIEW_NAMES:
        tab.button("roll left", "view").click()
        tab.leaves(lambda scene: scene.view.rotation, named_view(side))
        tab.button(side, "view").click()
        tab.becomes(lambda scene: scene.view.rotation, named_view(side))


def test_roll_turns_the_picture_and_reset_and_fit_lead_back(tab: Tab) -> None:
    beginning = tab.scene.view
    tab.button("roll left", "view").click()
    rolled = tab.until(lambda state: state.scene.view != beginning).view
    up = matrices.applied(matrices.transposed(matrices.rotation_from_quaternion(beginning.rotation)), (0.0, 1.0, 0.0))
    assert matrices.applied(matrices.rotation_from_quaternion(rolled.rotation), up)[0] < 0
    tab.types("centre i", "3")
    tab.until(lambda state: state.scene.view.center != beginning.center)
    tab.button("fit", "view").click()
    fitted = tab.becomes(lambda scene: scene.view.center, beginning.center).view
    assert fitted.rotation == rolled.rotation and fitted.zoom == beginning.zoom != "fit"
    tab.button("roll right", "view").click()
    back = tab.until(lambda state: state.scene.view.rotation != rolled.rotation).view
    assert back.rotation == pytest.approx(beginning.rotation, abs=ROTATION_ENTRY)
    tab.button("reset", "view").click()
    tab.becomes(lambda scene: scene.view, beginning)


def test_the_centre_is_typed_and_set_to_the_middle(tab: Tab) -> None:
    fitted = tab.scene.view.center
    tab.types("centre j", "4.5")
    tab.becomes(lambda scene: scene.view.center, (fitted[0], 4.5, fitted[2]))
    tab.page.wait_for_selector('[aria-pressed="false"]:has-text("middle")')
    tab.button("middle", "view").click()
    tab.becomes(lambda scene: scene.view.center, "middle")
    tab.page.wait_for_selector('[aria-pressed="true"]:has-text("middle")')


def test_another_up_turns_the_volume_under_every_name(tab: Tab) -> None:
    beginning = tab.scene.view
    tab.page.locator('[aria-label="up"]').click()
    tab.page.locator(".q-menu .q-item", has_text="-z").last.click()
    turned = tab.becomes(lambda scene: scene.view.up, "-z").view
    assert (turned.rotation, turned.zoom, turned.center) == (beginning.rotation, beginning.zoom, beginning.center)
    top = tab.button("top", "view")
    top.hover()
    tab.page.get_by_text("seen from inferior").wait_for()
    top.click()
    assert tab.becomes(lambda scene: scene.view.rotation, named_view("top")).view.up == "-z"
    tab.button("reset", "view").click()
    assert tab.becomes(lambda scene: scene.view.rotation, beginning.rotation).view.up == "-z"


def test_bounds_are_typed_counted_and_reset(tab: Tab) -> None:
    tab.types("lowest i", "5")
    tab.becomes(lambda scene: scene.bounds.low, (5, 0, 0))
    tab.field("lowest i").press("ArrowUp")
    tab.becomes(lambda scene: scene.bounds.low, (6, 0, 0))
    tab.types("end of k", "9")
    tab.becomes(lambda scene: scene.bounds, Bounds(low=(6, 0, 0), high=(-1, -1, 9)))
    tab.types("end of k", str(DIMS[2]))
    tab.becomes(lambda scene: scene.bounds.high, (-1, -1, -1))
    tab.button("reset", "bounds").click()
    tab.becomes(lambda scene: scene.bounds, Bounds())


def test_bounds_are_slid(tab: Tab) -> None:
    track = tab.page.locator(".vs-bound .q-range").nth(1)

    def slide(inset: float) -> None:
        """From so far within the left end, or the right one if that is below 0, to the middle."""
        track.scroll_into_view_if_needed()
        box = track.bounding_box()  # anew: what stands above may have grown
        assert box is not None
        left, width, middle = box["x"], box["width"], box["y"] + box["height"] / 2
        tab.drag((left + inset if inset > 0 else left + width + inset, middle), (left + width / 2, middle))

    slide(1)
    bounds = tab.until(lambda state: state.scene.bounds.low[1] > 0).bounds
    assert abs(bounds.low[1] - DIMS[1] / 2) <= 1 and bounds == Bounds(low=(0, bounds.low[1], 0))
    assert "bounds" in tab.state.unsettled
    tab.page.wait_for_function(
        "low => document.querySelector('[aria-label=\"lowest j\"]').value === low", arg=str(bounds.low[1])
    )
    slide(-1)
    bounds = tab.until(lambda state: state.scene.bounds.high[1] != -1).bounds
    assert bounds.low[1] < bounds.high[1] <= bounds.low[1] + 1  # a slab of one voxel at least


def test_each_thumb_of_a_range_says_where_it_is_and_how_far_it_goes(tab: Tab) -> None:
    lowest, end = (tab.page.get_by_role("slider", name=f"bounds on k, {which}") for which in ("lowest", "end"))
    tab.types("lowest k", "3")
    tab.shows(lowest, "aria-valuenow", "3")
    tab.shows(end, "aria-valuemin", "3")
    end.press("PageDown")
    tab.becomes(lambda scene: scene.bounds.high[2], DIMS[2] - 10)
    tab.shows(end, "aria-valuetext", str(DIMS[2] - 10))
    tab.shows(lowest, "aria-valuemax", str(DIMS[2] - 10))
    end.press("End")
    tab.becomes(lambda scene: scene.bounds, Bounds(low=(0, 0, 3)))
    lowest.press("Home")
    tab.becomes(lambda scene: scene.bounds, Bounds())


# -- how the image forms, and what it is


@pytest.mark.parametrize(
    ("words", "order"), [("back to front", Order.BACK_TO_FRONT), ("front to back", Order.FRONT_TO_BACK)]
)
def test_the_order_is_chosen(tab: Tab, words: str, order: Order) -> None:
    tab.button(words, "refinement").click()
    tab.becomes(lambda scene: scene.order, order)
    tab.shows(tab.button(words, "refinement"), "aria-pressed", "true")
    tab.button("fastest", "refinement").click()
    tab.becomes(lambda scene: scene.order, Order.FASTEST)


def test_refinement_and_kernel_are_chosen(tab: Tab) -> None:
    from playwright.sync_api import expect

    for finest in (Step.B, Step.G, Step.F):
        tab.choice(finest, "refine to").click()
        tab.becomes(lambda scene: scene.refine.finest, finest)
    tab.choice("C", "lit from step").click()
    tab.becomes(lambda scene: scene.refine.lit_from, Step.C)
    tab.page.get_by_role("switch", name="bare buffer").click()
    tab.becomes(lambda scene: scene.refine.bare_buffer, True)
    tab.page.get_by_label("kernel", exact=True).click()
    tab.page.get_by_role("option", name="bspline").click()
    tab.page.get_by_role("listbox").wait_for(state="hidden")  # it takes the focus along while it closes
    tab.becomes(lambda scene: scene.reconstruction.kernel, Kernel.BSPLINE)
    tab.types("radius, a number", "2.5")
    tab.becomes(lambda scene: scene.reconstruction.radius, 2.5)
    slider = tab.page.get_by_role("slider", name="radius")
    tab.shows(slider, "aria-valuenow", "2.5")
    for _ in range(10):  # a key has been seen to be lost right after the text field above
        slider.press("ArrowRight")
        with suppress(AssertionError):
            expect(slider).to_have_attribute("aria-valuenow", "2.6", timeout=3000)
            break
    tab.becomes(lambda scene: scene.reconstruction.radius, 2.6)
    tab.button("default", "refinement").click()
    tab.becomes(lambda scene: scene.reconstruction.radius, "default")


def test_a_slider_says_the_number_that_is_shown_whoever_changes_it(tab: Tab) -> None:
    power, slab = (tab.page.get_by_role("slider", name=name, exact=True) for name in ("specular power", "slab"))
    tab.shows(slab, "aria-valuetext", "1 voxel")
    tab.shows(slab, "aria-valuemin", "0.25")
    slab.press("ArrowRight")
    tab.shows(slab, "aria-valuetext", "1.05 voxels")
    for typed in ("25", "0.5", "37.77"):  # within the scale, below it, and between two of its steps
        tab.types("specular power, a number", typed)
        tab.shows(power, "aria-valuetext", typed)
        tab.shows(power, "aria-valuenow", str(max(float(typed), 1)).removesuffix(".0"))
    power.press("End")
    tab.shows(power, "aria-valuetext", "1000")
    tab.becomes(lambda scene: scene.shading.specular_power, 1000.0)
    power.press("Home")
    tab.becomes(lambda scene: scene.shading.specular_power, 1.0)
    power.press("ArrowRight")
    tab.shows(power, "aria-valuetext", "1.02")
    tab.holds("specular power, a number", "1.02")


def test_striding_is_switched_where_a_volume_has_levels_and_follows_another_tab(
    browser_page: Page, volume: Path, tmp_path: Path
) -> None:
    prepare_small(volume, tmp_path / "shells.zarr")
    with served(tmp_path / "shells.zarr") as (address, _):
        tabs = [Tab(page, address).load() for page in (browser_page, browser_page.context.new_page())]
        switches = [tab.page.get_by_role("switch", name="striding", exact=True) for tab in tabs]
        for tab, switch, other, value in zip(tabs, switches, reversed(switches), (True, False), strict=True):
            before = tab.scene.refine
            switch.click()
            after = tab.becomes(lambda scene: scene.refine.striding, value).refine
            assert after == msgspec.structs.replace(before, striding=value)
            tab.shows(switch, "aria-checked", str(value).lower())
            tab.shows(other, "aria-checked", str(value).lower())


def test_a_volume_without_levels_has_no_switch_for_striding(tab: Tab) -> None:
    assert tab.page.get_by_role("switch", name="bare buffer").count() == 1
    assert tab.page.get_by_role("switch", name="striding").count() == 0


def test_a_volume_without_step_g_has_no_controls_of_slabs(tab: Tab, browser_page: Page, tmp_path: Path) -> None:
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nvolsplat.kind:=labels\n\n"
    (tmp_path / "labels.nrrd").write_bytes(header.encode() + bytes(range(4)) * 16)
    alone = ["cast shadows", "occlusion", "depth cue", "silhouettes", "slab", "slab kernel"]
    assert len(alone) == sum(key.told.slabs_alone for key in KEYS.values())
    with served(tmp_path / "labels.nrrd") as (address, _):
        without = Tab(browser_page, address).load()
        for label in alone:
            assert tab.field(label).count() >= 1 and without.field(label).count() == 0, label
        assert without.field("kernel").count() == 1


def test_the_code_of_directions_is_chosen(tab: Tab) -> None:
    for directions in ("paper", "octahedral"):
        tab.button(directions, "image").click()
        tab.becomes(lambda scene: scene.quantise.directions, directions)
        tab.shows(tab.button(directions, "image"), "aria-pressed", "true")


def test_the_density_window_is_typed_and_automatic_again(tab: Tab) -> None:
    automatic = tab.field("lowest value").input_value(), tab.field("highest value").input_value()
    tab.types("highest value", "123.5")
    window = tab.until(lambda state: state.scene.quantise.window != "auto").quantise.window
    assert window[1] == 123.5 and shown_number(float(window[0])) == automatic[0]
    tab.button("automatic", "window").click()
    tab.becomes(lambda scene: scene.quantise.window, "auto")
    tab.page.wait_for_function(
        "value => document.querySelector('[aria-label=\"highest value\"]').value === value", arg=automatic[1]
    )


def test_the_density_window_holds_as_many_voxels_as_asked(tab: Tab) -> None:
    windows: dict[str, tuple[float, float]] = {}
    for button in ("all", "1–99 %", "5–95 %"):
        tab.button(button, "window").click()
        tab.page.wait_for_selector(f'[aria-pressed="true"]:has-text("{button}")')
        chosen = tab.until(lambda state: state.scene.quantise.window not in ("auto", *windows.values())).quantise.window
        assert chosen != "auto"
        windows[button] = chosen
        tab.holds("lowest value", shown_number(chosen[0]))
    assert windows["all"][0] <= windows["1–99 %"][0] <= windows["5–95 %"][0]
    assert windows["5–95 %"][1] <= windows["1–99 %"][1] <= windows["all"][1]
    assert tab.page.locator('[aria-pressed="true"]:has-text("all")').count() == 0
    tab.button("automatic", "window").click()
    tab.becomes(lambda scene: scene.quantise.window, "auto")


def test_the_image_has_a_fixed_size_or_follows_the_window(tab: Tab) -> None:
    assert not tab.field("width").is_visible()
    tab.button("fixed", "image").click()
    tab.types("width", "320")
    tab.types("height", "200")
    image = tab.becomes(lambda scene: scene.image.height, 200).image
    assert image.width == 320
    tab.button("follows the window", "image").click()
    tab.field("width").wait_for(state="hidden")


def test_background_and_edges_are_set(tab: Tab) -> None:
    tab.types("background, #rrggbb", "#336699")
    tab.becomes(lambda scene: scene.image.background, (0x33 / 255, 0x66 / 255, 0x99 / 255))
    tab.holds("background", "#336699")
    tab.field("background").fill("#ff0000")
    tab.becomes(lambda scene: scene.image.background, (1.0, 0.0, 0.0))
    tab.page.get_by_role("switch", name="white edges of the volume").click()
    tab.becomes(lambda scene: scene.image.edges, True)


@pytest.fixture
def late_black(browser_page: Page, url: str) -> tuple[Tab, HeldAnswers]:
    """A tab that shows a background which is black by now, of which the tab has not heard."""
    answers = HeldAnswers(browser_page)
    tab = Tab(browser_page, url).load()
    tab.types("background, #rrggbb", "#336699")
    tab.holds("background", "#336699")
    answers.keep()
    assert browser_page.request.get(f"{url}/again").ok
    answers.kept_until("#000000")
    return tab, answers


def test_what_is_typed_stays_where_the_server_tells_late_what_was_there(late_black: tuple[Tab, HeldAnswers]) -> None:
    tab, answers = late_black
    tab.field("background, #rrggbb").fill("#ff0000")
    answers.let_all_pass()
    tab.holds("background, #rrggbb", "#ff0000")
    tab.field("background, #rrggbb").press("Enter")
    tab.becomes(lambda scene: scene.image.background, (1.0, 0.0, 0.0))


def test_a_picked_colour_stays_where_the_server_tells_late_what_was_there(late_black: tuple[Tab, HeldAnswers]) -> None:
    tab, answers = late_black
    late = answers.kept_until("#000000")
    tab.field("background").fill("#ff0000")
    answers.let_pass(late)
    assert tab.field("background").input_value() == "#ff0000"
    answers.let_all_pass()
    tab.becomes(lambda scene: scene.image.background, (1.0, 0.0, 0.0))


# -- bad input


BAD_INPUT = [
    ("specular power, a number", "shiny", "“shiny” is not a number"),
    ("specular power, a number", "", "give a number"),
    ("specular power, a number", "0", "specular_power must be above 0 and at most 1000"),
    ("specular power, a number", "nan", "specular_power must be above 0"),
    ("centre i", "1,5", "is not a number"),
    ("centre k", "inf", "center must be finite"),
    ("centre i", "1e12", "lower the zoom or move the centre"),
    ("lowest i", "1.5", "“1.5” is not a whole number"),
    ("lowest i", "-1", "give low < high within that range"),
    ("lowest j", "20", "give low < high within that range"),
    ("end of j", "21", "the volume has j from 0 to 20"),
    ("end of k", "-1", "bounds on k must end above 0"),
    ("radius, a number", "5", "radius must be 1 to 4 voxels"),
    ("radius, a number", "wide", "“wide” is not a number"),
    ("lowest value", "1e30", "window must rise"),
    ("highest value", "-inf", "window must be finite"),
    ("background, #rrggbb", "red", "is not a colour"),
]


def test_bad_input_is_told_at_the_field_and_changes_nothing(tab: Tab) -> None:
    before = tab.scene
    for field, text, words in BAD_INPUT:
        shown = tab.field(field).input_value()
        tab.field(field).fill(text)
        tab.complaint(field).get_by_text(words).wait_for()
        tab.field(field).press("Enter")
        tab.complaint(field).get_by_text(words).wait_for()
        assert tab.scene == before, (field, text)
        tab.field(field).blur()
        tab.complaint(field).wait_for(state="detached")
        tab.holds(field, shown)
        assert tab.scene == before, (field, text)


def test_a_bad_size_is_told_at_the_field(tab: Tab) -> None:
    tab.button("fixed", "image").click()
    before = tab.scene
    for field, text in (("width", "0"), ("height", "20000"), ("width", "wide")):
        tab.types(field, text)
        tab.complaint(field).get_by_text("1 to 16384 pixels" if text != "wide" else "is not a whole number").wait_for()
        assert tab.scene == before


# -- tabs, steps and servers


def test_two_tabs_stay_in_step(tab: Tab, url: str) -> None:
    other = Tab(tab.page.context.new_page(), url).load()
    on = tab.page.locator('.q-toggle[aria-checked="true"]').count()
    tab.types("lowest k", "7")
    tab.page.get_by_role("radio", name="Emitted by grid j").click()
    tab.page.get_by_role("switch", name="diffuse").click()
    tab.button("front to back", "refinement").click()
    tab.becomes(lambda scene: scene.order, Order.FRONT_TO_BACK)
    other.page.wait_for_function(
        """on => document.querySelector('[aria-label="lowest k"]').value === "7" &&
        document.querySelector('[aria-label="Emitted by grid j"]').checked &&
        document.querySelectorAll('.q-toggle[aria-checked="true"]').length === on - 1 &&
        [...document.querySelectorAll('[aria-pressed="true"]')].some((e) => e.innerText === "front to back")""",
        arg=on,
    )
    other.types("lowest k", "3")
    tab.page.wait_for_function("() => document.querySelector('[aria-label=\"lowest k\"]').value === '3'")


def test_every_step_is_ticked_and_timed_once_the_image_is_finished(tab: Tab) -> None:
    tab.button("roll left", "view").click()
    tab.page.wait_for_function("() => document.querySelectorAll('.vs-step.vs-done').length === 6")
    for step in PAPER_STEPS:
        chip = tab.page.locator(f'.vs-step[data-step="{step}"]')
        assert re.search(r"\(\d[\d.]* m?s\)$", chip.get_attribute("title") or "")
    assert tab.page.locator(".vs-step.vs-now").count() == 1


def test_at_rest_the_image_refines_to_g_if_that_is_asked_for(tab: Tab) -> None:
    tab.choice("G", "refine to").click()
    tab.page.locator('.vs-step[data-step="G"].vs-done').wait_for()
    assert (
        " s)" in (title := tab.page.locator('.vs-step[data-step="G"]').get_attribute("title") or "") or "ms)" in title
    )
    seen = tab.scene.view
    tab.button("roll left", "view").click()
    tab.until(lambda state: state.scene.view != seen and state.finished == Step.G)
    tab.page.wait_for_function("() => document.querySelectorAll('.vs-step.vs-done').length === 7")


def test_a_volume_of_labels_cannot_be_refined_to_g_and_says_why(browser_page: Page, tmp_path: Path) -> None:
    numbers = torch.arange(8**3)
    labels = torch.where(numbers < 300, 0, numbers % 5).reshape(8, 8, 8).to(torch.uint8)
    write_volume(tmp_path / "labels.nrrd", labels, Geometry((8, 8, 8)))
    with served(tmp_path / "labels.nrrd") as (url, _):
        tab = Tab(browser_page, url).load()
        assert tab.choice("F", "refine to").is_enabled()
        to_g = tab.choice("G", "refine to")
        assert to_g.is_disabled()
        assert "labels.nrrd holds the whole numbers 0 to 4" in (to_g.get_attribute("title") or "")


def test_one_click_shows_the_papers_order_and_another_the_fastest(tab: Tab) -> None:
    press = tab.page.locator("header").get_by_role("button", name="back to front")
    press.click()
    tab.becomes(lambda scene: scene.order, Order.BACK_TO_FRONT)
    tab.page.get_by_text("drawn back to front").wait_for()
    press.click()
    tab.becomes(lambda scene: scene.order, Order.FASTEST)


def test_the_servers_panel_tells_who_did_what_and_nothing_while_closed(tab: Tab) -> None:
    rows = tab.page.locator(".vs-servers-table:not(.vs-links-table) tbody tr")
    tab.page.locator('.vs-step[data-step="F"].vs-done').wait_for()
    assert rows.count() == 0
    tab.page.get_by_text("Servers", exact=True).click()
    tab.page.get_by_text("last frame: step F").wait_for()
    names = [row.locator("td").first.inner_text() for row in rows.all()]
    assert sorted(name.rstrip("0123456789 ") for name in names) == ["map/shade", "map/shade", "splat server"]
    voxels = [row.locator("td").nth(3).inner_text().replace(",", "") for row in rows.all()]
    assert sum(int(count) for count in voxels if count) == DIMS[0] * DIMS[1] * DIMS[2]
    assert all(f"{socket.gethostname()}, " in row.locator("td").nth(1).inner_text() for row in rows.all())
    links = [row.locator("td").all_inner_texts() for row in tab.page.locator(".vs-links-table tbody tr").all()]
    assert [link[1].rstrip("0123456789 ") for link in links] == ["splat server", "splat server", "client"]
    assert all(float(link[3].replace(",", "")) > 0 for link in links)
    assert tab.page.locator(".vs-timeline > text").count() == 3
    assert tab.page.locator(".vs-timeline rect").count() >= 3
    assert "bottleneck: " in tab.page.locator(".vs-frame-said").inner_text()
    heads = tab.page.locator(".vs-servers-table").first.locator("th")
    assert "splat, ms" in heads.all_inner_texts()
    tab.choice("G", "refine to").click()
    tab.page.get_by_text("last frame: step G").wait_for()
    stages = ["adding", "densities", "shading", "compositing", "publishing"]
    columns = [heads.all_inner_texts().index(f"{stage}, ms") for stage in stages]
    (splat,) = (row.locator("td").all_inner_texts() for row in rows.all() if "splat" in row.inner_text())
    assert all(float(splat[column]) >= 0 for column in columns) and float(splat[columns[0]]) > 0
    assert "splat, ms" not in heads.all_inner_texts()
    assert set(stages) < set(tab.page.locator(".vs-legend span").all_inner_texts())


def test_a_lost_server_is_told_in_words(browser: Browser, volume: Path) -> None:
    with served(volume) as (address, program), patient_context(browser) as context:
        page = context.new_page()
        tab = Tab(page, address).load()
        page.get_by_text("Servers", exact=True).click()
        page.locator(".vs-servers-table tbody tr").nth(2).wait_for()
        below = psutil.Process(program.pid).children(recursive=True)
        next(process for process in below if is_server(process, "mapshade_server")).kill()
        tab.button("roll left", "view").click()
        page.locator(".vs-server-lost td", has_text="lost: ").wait_for()
        page.locator(".vs-losses", has_text="lost since the start: 1 map/shade server").wait_for()
