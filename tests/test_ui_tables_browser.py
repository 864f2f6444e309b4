"""The four tables in a real browser: what a person does with the mouse, the keys and the menus changes the scene."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from browser import browser, browser_page
from tables_page import SCENE, VOLUME, WINDOW

from tolerances import FREEHAND_PIXELS, ONE_PIXEL_OF_A_TABLE, ROUNDING
from volsplat.client.presets import preset_scene
from volsplat.client.ui.field_histograms import density_counts
from volsplat.client.ui.table_edits import Table, constant, inverted, mirrored, ramp, steps
from volsplat.client.ui.table_files import table_toml
from volsplat.protocol.scene import Field, Scene, Tables

if TYPE_CHECKING:
    from playwright.sync_api import FloatRect, Locator, Page

__all__ = ["browser", "browser_page"]

PROGRAM = Path(__file__).parent / "tables_page.py"
PATIENCE = 10_000  # milliseconds, for what the page is to show
TITLES = {"emit": "Emitted", "refl": "Reflected", "opac": "Opacity", "modu": "Modulation"}


class Tab:
    """A tab on the panel, and the scene behind it."""

    def __init__(self, page: Page, url: str) -> None:
        self.page = page
        self.url = url
        page.set_default_timeout(PATIENCE)
        page.goto(url)
        page.wait_for_selector('[aria-label="Modulation"] circle[role=slider]')

    @property
    def scene(self) -> Scene:
        return msgspec.json.decode(self.page.request.get(f"{self.url}/scene").body(), type=Scene)

    @property
    def tables(self) -> Tables:
        return self.scene.tables

    def table(self, which: str) -> Locator:
        return self.page.locator(f'section[aria-label="{TITLES[which]}"]')

    def points(self, which: str) -> Locator:
        return self.table(which).locator("circle[role=slider]")

    def waits_for(self, holds: Callable[[Scene], bool]) -> Scene:
        """The scene, as soon as it is so."""
        found: list[Scene] = []

        def look() -> bool:
            found.append(self.scene)
            return holds(found[-1])

        until(self.page, look)
        return found[-1]

    def place(self, which: str, position: float, value: float) -> tuple[float, float]:
        """Where a table's position and value lie in the window, by its own first and last grid lines."""
        lines = self.table(which).locator('[data-part="grid"] line')
        top, bottom = box(lines.nth(2)), box(lines.nth(0))
        return (top["x"] + position * top["width"], bottom["y"] + value * (top["y"] - bottom["y"]))

    def on_strip(self, which: str, position: float) -> tuple[float, float]:
        strip = box(self.table(which).locator('[data-part="strip"]'))
        return (strip["x"] + position * strip["width"], strip["y"] + strip["height"] / 2)

    def drag(self, start: tuple[float, float], *way: tuple[float, float]) -> None:
        self.page.mouse.move(*start)
        self.page.mouse.down()
        for place in way:
            self.page.mouse.move(*place, steps=5)
        self.page.mouse.up()

    def choose(self, which: str, *items: str) -> None:
        """Click through a table's menu."""
        self.page.get_by_label(f"{TITLES[which]}: more").click()
        for item in items:
            self.page.locator(".vs-menu .q-item").filter(has_text=item).last.click()

    def field(self, which: str, name: str) -> Locator:
        return self.table(which).locator(f'input[name="{name}"]')

    def types(self, which: str, name: str, text: str) -> None:
        self.field(which, name).fill(text)
        self.field(which, name).press("Enter")

    def complaint(self, which: str) -> str:
        return self.table(which).get_by_role("alert").inner_text()


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait until it holds, letting the page go on."""
    for _ in range(PATIENCE // 20):
        if holds():
            return
        page.wait_for_timeout(20)
    raise AssertionError("what the page was to do did not happen")


def box(locator: Locator) -> FloatRect:
    found = locator.bounding_box()
    assert found is not None
    return found


def near(value: float) -> object:
    return pytest.approx(value, abs=ONE_PIXEL_OF_A_TABLE)


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with subprocess.Popen([sys.executable, str(PROGRAM)], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        yield program.stdout.readline().strip()
        program.terminate()


@pytest.fixture
def tab(browser_page: Page, url: str) -> Tab:
    assert browser_page.request.post(f"{url}/reset").ok
    return Tab(browser_page, url)


# -- points


def test_a_dragged_point_lands_under_the_pointer(tab: Tab) -> None:
    tab.drag(tab.place("opac", 0.4, 0.5), tab.place("opac", 0.6, 0.9))
    tables = tab.waits_for(lambda scene: scene.tables != SCENE.tables).tables
    assert tables.opac.points[1] == (near(0.6), near(0.9))
    assert tables == msgspec.structs.replace(SCENE.tables, opac=tables.opac)


def test_neighbours_bound_a_dragged_point_and_shift_keeps_its_value(tab: Tab) -> None:
    tab.page.keyboard.down("Shift")
    tab.drag(tab.place("opac", 0.4, 0.5), tab.place("opac", 0.95, 0.1))
    tab.page.keyboard.up("Shift")
    tab.waits_for(lambda scene: scene.tables.opac.points[1] == (0.8, 0.5))


def test_a_whole_drag_is_undone_and_redone_at_once(tab: Tab) -> None:
    assert tab.page.get_by_label("undo").is_disabled()
    tab.drag(tab.place("opac", 0.4, 0.5), tab.place("opac", 0.6, 0.9), tab.place("opac", 0.5, 0.2))
    dragged = tab.waits_for(lambda scene: scene.tables.opac.points[1][1] == near(0.2))
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)
    assert tab.page.get_by_label("undo").is_disabled()
    tab.page.get_by_label("redo").click()
    tab.waits_for(lambda scene: scene == dragged)


def test_escape_takes_a_drag_back(tab: Tab) -> None:
    tab.page.mouse.move(*tab.place("opac", 0.4, 0.5))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.place("opac", 0.6, 0.9), steps=5)
    tab.waits_for(lambda scene: scene != SCENE)
    tab.page.keyboard.press("Escape")
    tab.waits_for(lambda scene: scene == SCENE)
    tab.page.mouse.up()
    assert tab.scene == SCENE


def test_picking_a_point_changes_nothing(tab: Tab) -> None:
    tab.page.mouse.click(*tab.place("opac", 0.4, 0.5))
    until(tab.page, lambda: tab.field("opac", "value").input_value() == "0.5")
    tab.page.mouse.click(*tab.place("opac", 0.6, 0.5))  # and this adds one: the first change
    tab.waits_for(lambda scene: len(scene.tables.opac.points) == 4)
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)
    assert tab.page.get_by_label("undo").is_disabled()


def test_a_click_on_the_line_adds_a_point_and_right_click_removes_it(tab: Tab) -> None:
    x, y = tab.place("opac", 0.6, 0.5)
    tab.page.mouse.click(x, y)
    points = tab.waits_for(lambda scene: len(scene.tables.opac.points) == 4).tables.opac.points
    assert points[2] == (near(0.6), near(0.5))
    tab.page.mouse.click(x, y, button="right")
    tab.waits_for(lambda scene: scene == SCENE)


def test_a_double_click_adds_a_point_anywhere(tab: Tab) -> None:
    tab.page.mouse.dblclick(*tab.place("opac", 0.6, 0.85))
    points = tab.waits_for(lambda scene: scene != SCENE).tables.opac.points
    assert len(points) == 4
    assert points[2] == (near(0.6), near(0.85))


def test_delete_removes_a_point_but_never_the_last(tab: Tab) -> None:
    for left in (2, 1):
        tab.points("opac").first.focus()
        tab.page.keyboard.press("Delete")
        tab.waits_for(lambda scene, left=left: len(scene.tables.opac.points) == left)  # type: ignore[misc]
    tab.points("opac").first.focus()
    tab.page.keyboard.press("Delete")
    until(tab.page, lambda: tab.complaint("opac") == "a table needs at least one point")
    assert tab.tables.opac.points == (SCENE.tables.opac.points[2],)


def test_keys_move_a_point_one_entry_and_finer_with_shift(tab: Tab) -> None:
    tab.points("opac").nth(1).focus()
    for _ in range(3):
        tab.page.keyboard.press("ArrowRight")
    tab.page.keyboard.press("Shift+ArrowDown")
    points = tab.waits_for(lambda scene: scene.tables.opac.points[1][1] < 0.5).tables.opac.points
    assert points[1] == pytest.approx((0.4 + 3 / 255, 0.499), abs=ROUNDING)
    assert "of 3" in (tab.points("opac").nth(1).get_attribute("aria-label") or "")


def test_tab_goes_from_point_to_point(tab: Tab) -> None:
    tab.points("opac").first.focus()
    tab.page.keyboard.press("Tab")
    tab.page.keyboard.press("ArrowUp")
    tab.waits_for(lambda scene: scene.tables.opac.points[1][1] == pytest.approx(0.51, abs=ROUNDING))


def test_the_value_under_the_pointer_is_told_in_the_datas_units(tab: Tab) -> None:
    tab.page.mouse.move(*tab.place("opac", 0.5, 0.1))
    text = tab.table("opac").locator("output").inner_text()
    density, _, opacity = text.partition(" → ")
    assert float(density) == pytest.approx(sum(WINDOW) / 2, abs=20)
    assert float(opacity) == pytest.approx(0.5, abs=ROUNDING)
    tab.page.mouse.move(5, 5)
    assert tab.table("opac").locator("output").inner_text() == ""


# -- drawing


def test_a_freehand_curve_becomes_the_table(tab: Tab) -> None:
    tab.page.get_by_label("Opacity: draw freehand").click()
    tab.drag(tab.place("opac", 0.0, 0.9), tab.place("opac", 0.5, 0.1), tab.place("opac", 1.0, 0.7))
    entries = tab.waits_for(lambda scene: scene.tables.opac.points[-1][0] == 1.0).tables.opac.entries()
    for n, entry in enumerate(entries):
        position = n / 255
        drawn = 0.9 - 1.6 * position if position < 0.5 else 0.1 + 1.2 * (position - 0.5)
        assert entry == pytest.approx(drawn, abs=FREEHAND_PIXELS)
    until(tab.page, lambda: not tab.page.get_by_label("undo").is_disabled())
    assert 3 <= len(tab.tables.opac.points) < 256
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)


def test_the_pencil_changes_only_what_it_passes(tab: Tab) -> None:
    tab.page.get_by_label("Opacity: draw freehand").click()
    tab.drag(tab.place("opac", 0.5, 0.9), tab.place("opac", 0.6, 0.9))
    drawn = tab.waits_for(lambda scene: scene.tables.opac.greatest > 0.8).tables.opac.entries()
    before = SCENE.tables.opac.entries()
    for n in [*range(125), *range(156, 256)]:
        assert drawn[n] == pytest.approx(before[n], abs=FREEHAND_PIXELS)
    for n in range(130, 151):
        assert drawn[n] == pytest.approx(0.9, abs=FREEHAND_PIXELS)


def test_a_colours_brightness_or_one_channel_can_be_drawn(tab: Tab) -> None:
    tab.page.get_by_label("Reflected: draw freehand").click()
    tab.drag(tab.place("refl", 0.0, 0.3), tab.place("refl", 1.0, 0.3))
    tables = tab.waits_for(lambda scene: scene.tables.refl.entries()[-1][0] == near(0.3)).tables
    for colour in tables.refl.entries():
        assert colour == pytest.approx((0.3, 0.3, 0.3), abs=FREEHAND_PIXELS)
    tab.table("refl").get_by_text("green").click()
    tab.drag(tab.place("refl", 0.0, 0.8), tab.place("refl", 1.0, 0.8))
    tables = tab.waits_for(lambda scene: scene.tables.refl.entries()[-1][1] == near(0.8)).tables
    for colour in tables.refl.entries():
        assert colour == pytest.approx((0.3, 0.8, 0.3), abs=FREEHAND_PIXELS)


def test_the_pencil_paints_the_strip(tab: Tab) -> None:
    tab.page.get_by_label("Reflected: draw freehand").click()
    tab.field("refl", "paint").fill("#ff0000")
    tab.drag(tab.on_strip("refl", 0.25), tab.on_strip("refl", 0.5))
    entries = tab.waits_for(lambda scene: scene.tables.refl != SCENE.tables.refl).tables.refl.entries()
    assert entries[96] == pytest.approx((1.0, 0.0, 0.0), abs=ROUNDING)
    assert entries[20] == entries[200] == pytest.approx((0.6, 0.6, 0.6), abs=ROUNDING)


# -- colours


def test_a_picked_colour_becomes_the_stops(tab: Tab) -> None:
    tab.page.mouse.click(*tab.on_strip("emit", 0.8))
    tab.field("emit", "picker").fill("#3366cc")
    tables = tab.waits_for(lambda scene: scene != SCENE).tables
    assert tables.emit.points == ((0.2, (0.0, 0.0, 0.0)), (0.8, (0x33 / 255, 0x66 / 255, 0xCC / 255)))
    until(tab.page, lambda: tab.field("emit", "value").input_value() == "#3366cc")
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)


def test_a_stop_is_added_with_the_strips_colour_and_dragged(tab: Tab) -> None:
    tab.drag(tab.on_strip("emit", 0.5), tab.on_strip("emit", 0.7))
    points = tab.waits_for(lambda scene: scene != SCENE).tables.emit.points
    assert points[1][0] == near(0.7)
    assert points[1][1] == pytest.approx((0.5, 0.3, 0.1), abs=2 * ONE_PIXEL_OF_A_TABLE)


# -- typing


def test_a_point_can_be_typed_in_the_datas_units(tab: Tab) -> None:
    tab.points("opac").nth(1).focus()
    tab.types("opac", "position", "275")
    tab.waits_for(lambda scene: scene.tables.opac.points[1][0] == pytest.approx(0.5, abs=ROUNDING))
    tab.types("opac", "value", "0.123")
    tab.waits_for(lambda scene: scene.tables.opac.points[1][1] == 0.123)


def test_what_is_typed_is_for_the_point_that_was_selected(tab: Tab) -> None:
    tab.points("opac").nth(1).focus()
    tab.field("opac", "value").fill("0.75")
    tab.page.mouse.click(*tab.place("opac", 0.8, 0.5))
    tab.waits_for(lambda scene: [value for _, value in scene.tables.opac.points] == [0.0, 0.75, 0.5])
    until(tab.page, lambda: tab.field("opac", "value").input_value() == "0.5")


def test_a_colour_can_be_typed(tab: Tab) -> None:
    tab.points("emit").nth(0).focus()
    tab.types("emit", "value", "#ff8000")
    tab.waits_for(lambda scene: scene.tables.emit.points[0] == (0.2, (1.0, 128 / 255, 0.0)))


@pytest.mark.parametrize(
    "which, name, text, told",
    [
        ("opac", "position", "abc", "“abc” is not a number"),
        ("opac", "position", "", "“” is not a number"),
        ("opac", "position", "2000", "must lie between −490 and 1040"),
        ("opac", "position", "-900", "must lie between −490 and 1040"),
        ("opac", "value", "1.5", "“1.5” is not a number from 0 to 1"),
        ("opac", "value", "-0.1", "“-0.1” is not a number from 0 to 1"),
        ("opac", "value", "NaN", "“NaN” is not a number from 0 to 1"),
        ("emit", "value", "red", "“red” is not a colour: type #rrggbb"),
    ],
)
def test_bad_numbers_are_told_at_the_field_and_change_nothing(
    tab: Tab, which: str, name: str, text: str, told: str
) -> None:
    tab.points(which).nth(1).focus()
    shown = tab.field(which, name).input_value()
    tab.types(which, name, text)
    assert tab.complaint(which) == told
    assert tab.field(which, name).get_attribute("aria-invalid") == "true"
    tab.field(which, name).blur()
    assert tab.field(which, name).input_value() == shown
    assert tab.scene == SCENE


# -- menus


@pytest.mark.parametrize("which", TITLES)
@pytest.mark.parametrize(
    "item, edit",
    [
        ("Ramp up", ramp),
        ("Ramp down", lambda table: ramp(table, rising=False)),
        ("Constant", None),
        ("Invert", inverted),
        ("Mirror", mirrored),
    ],
)
def test_the_menu_edits_the_table(tab: Tab, which: str, item: str, edit: Callable[[Table], Table] | None) -> None:
    before: Table = getattr(SCENE.tables, which)
    first = before.points[0][1]
    expected = edit(before) if edit else constant(before, first if isinstance(first, tuple) else (first,))
    tab.points(which).first.focus()
    tab.choose(which, item)
    tab.waits_for(lambda scene: scene.tables == msgspec.structs.replace(SCENE.tables, **{which: expected}))


def test_a_table_is_cut_into_as_many_steps_as_asked(tab: Tab) -> None:
    tab.page.get_by_label("Opacity: more").click()
    number = tab.page.get_by_label("Opacity: number of steps")
    number.fill("one")
    number.press("Enter")
    tab.page.get_by_text("a whole number").wait_for()
    number.fill("1")
    number.press("Enter")
    tab.page.get_by_text("steps must be 2 to 64, not 1").wait_for()
    assert tab.scene == SCENE
    number.fill("4")
    tab.page.get_by_text("Make steps").click()
    tab.waits_for(lambda scene: scene.tables.opac == steps(SCENE.tables.opac, 4))


def test_one_table_is_taken_from_a_preset_with_what_indexes_it(tab: Tab) -> None:
    tab.choose("emit", "From a preset", "ct-skin")
    preset = preset_scene("ct-skin", density_counts(VOLUME, SCENE.quantise))
    scene = tab.waits_for(lambda scene: scene.tables.emit == preset.tables.emit)
    assert scene.cross_bar.emit == preset.cross_bar.emit == Field.SCREEN_Z
    assert scene.tables == msgspec.structs.replace(SCENE.tables, emit=preset.tables.emit)
    until(tab.page, lambda: "screen z" in tab.table("emit").locator(".vs-table-field").inner_text())


def test_a_whole_preset_keeps_the_view_and_the_picture(tab: Tab) -> None:
    tab.page.get_by_text("Presets").click()
    tab.page.get_by_text("ct-skin").click()
    preset = preset_scene("ct-skin", density_counts(VOLUME, SCENE.quantise))
    scene = tab.waits_for(lambda scene: scene.tables == preset.tables)
    assert (scene.cross_bar, scene.shading, scene.light) == (preset.cross_bar, preset.shading, preset.light)
    assert (scene.view, scene.image, scene.quantise) == (SCENE.view, SCENE.image, SCENE.quantise)


def test_all_opacities_follow_one_slider(tab: Tab) -> None:
    tab.page.get_by_label("greatest opacity of the opacity table").locator("[tabindex]").focus()
    for _ in range(10):
        tab.page.keyboard.press("ArrowLeft")
    points = tab.waits_for(lambda scene: scene.tables.opac.greatest < 0.45).tables.opac.points
    assert [position for position, _ in points] == [position for position, _ in SCENE.tables.opac.points]
    assert points[0][1] == 0.0
    assert points[1][1] == points[2][1]


# -- files and other tabs


def test_a_table_is_saved_and_loaded(tab: Tab, tmp_path: Path) -> None:
    with tab.page.expect_download() as download:
        tab.choose("opac", "Save as a file")
    assert download.value.suggested_filename == "opac.toml"
    saved = tmp_path / "opac.toml"
    download.value.save_as(saved)
    assert saved.read_text() == table_toml(SCENE, "opac")
    load(tab, "modu", saved)
    tab.waits_for(lambda scene: scene.tables.modu == SCENE.tables.opac)


def test_a_file_that_holds_no_table_is_told_at_the_table(tab: Tab, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[tables.opac]\npoints = [[0.5, 7]]\n")
    load(tab, "opac", wrong)
    until(tab.page, lambda: tab.complaint("opac").startswith("wrong.toml: tables.opac"))
    assert tab.scene == SCENE


def load(tab: Tab, which: str, path: Path) -> None:
    with tab.page.expect_file_chooser() as chooser:
        tab.choose(which, "Load a file…")
    chooser.value.set_files(path)


def test_two_tabs_stay_in_step_and_a_drag_is_not_disturbed(tab: Tab) -> None:
    other = Tab(tab.page.context.new_page(), tab.url)
    tab.page.mouse.move(*tab.place("opac", 0.4, 0.5))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.place("opac", 0.6, 0.9), steps=5)
    tab.waits_for(lambda scene: scene.tables.opac.points[1] == (near(0.6), near(0.9)))
    until(other.page, lambda: "0.9" in (other.points("opac").nth(1).get_attribute("aria-valuetext") or ""))
    other.choose("opac", "Invert")
    tab.waits_for(lambda scene: scene.tables.opac.points[0][1] == 1.0)
    tab.page.mouse.move(*tab.place("opac", 0.5, 0.2), steps=5)
    tab.page.mouse.up()
    points = tab.waits_for(lambda scene: scene.tables.opac.points[0][1] == 0.0).tables.opac.points
    assert points == ((0.2, 0.0), (near(0.5), near(0.2)), (0.8, 0.5))
    until(other.page, lambda: "0.2" in (other.points("opac").nth(1).get_attribute("aria-valuetext") or ""))


def test_the_histogram_can_be_linear(tab: Tab) -> None:
    histogram = tab.table("opac").locator('[data-part="histogram"]')
    logarithmic = histogram.get_attribute("d")
    tab.page.get_by_label("Opacity: logarithmic histogram").click()
    assert histogram.get_attribute("d") not in (logarithmic, "")
    assert tab.scene == SCENE
