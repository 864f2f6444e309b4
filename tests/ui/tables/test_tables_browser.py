"""The points of the four tables in a real browser: dragged, added, typed and coloured, they change the scene."""

from __future__ import annotations

import msgspec
import pytest

from support.pages.tables_page import SCENE, VOLUME, WINDOW
from support.pages.tables_tab import TITLES, Tab, box, near, until
from tolerances import ONE_PIXEL_OF_A_TABLE, ROUNDING
from volsplat.client.volume.field_axis import field_axis
from volsplat.protocol.description.shading_tables import Field

STRENGTHS = field_axis(VOLUME, Field.STRENGTH, SCENE.quantise)
COUNTING = """
  window.told = window.frames = 0;
  const emit = window.socket.emit;
  window.socket.emit = function (kind, message, ...rest) {
    if (message?.args?.some((text) => text.includes('"points"'))) window.told += 1;
    return emit.call(this, kind, message, ...rest);
  };
  const frame = () => { window.frames += 1; requestAnimationFrame(frame); };
  requestAnimationFrame(frame);
"""


# -- points


def test_a_dragged_point_lands_under_the_pointer(tab: Tab) -> None:
    tab.drag(tab.place("opac", 0.4, 0.5), tab.place("opac", 0.6, 0.9))
    tables = tab.settles(lambda scene: scene.tables != SCENE.tables).tables
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
    dragged = tab.settles(lambda scene: scene.tables.opac.points[1][1] == near(0.2))
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)
    until(tab.page, lambda: tab.page.get_by_label("undo").is_disabled())
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


def test_a_drag_is_told_at_most_once_a_frame(fresh_tab: Tab) -> None:
    tab = fresh_tab
    tab.page.evaluate(COUNTING)
    tab.drag(tab.place("opac", 0.4, 0.5), *[tab.place("opac", 0.3 + n / 40, 0.1 + n / 20) for n in range(16)])
    told, frames = tab.page.evaluate("[window.told, window.frames]")
    assert 2 <= told <= frames + 1  # and once more, at the end


def test_picking_a_point_changes_nothing(tab: Tab) -> None:
    tab.page.mouse.click(*tab.place("opac", 0.4, 0.5))
    until(tab.page, lambda: tab.field("opac", "value").input_value() == "0.5")
    tab.page.mouse.click(*tab.place("opac", 0.6, 0.5))  # and this adds one: the first change
    tab.waits_for(lambda scene: len(scene.tables.opac.points) == 4)
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)
    until(tab.page, lambda: tab.page.get_by_label("undo").is_disabled())


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


# -- the value under the pointer in the image


def test_the_value_in_the_image_is_marked_in_the_tables_that_it_indexes(tab: Tab) -> None:
    tell(tab, {"density": 275.0, "strength": STRENGTHS.high / 4, "grid-i": 0, "grid-j": 1, "grid-k": 2})
    for which, position in (("emit", 0.5), ("refl", 0.5), ("opac", 0.5), ("modu", 0.25)):
        assert marked(tab, which) == near(position)
    tab.choose("emit", "From a preset", "galaxy")  # which indexes it by grid k
    until(tab.page, lambda: "grid k" in tab.table("emit").locator(".vs-table-field").inner_text())
    assert marked(tab, "emit") == near(2 / 63.75)
    tell(tab, {"density": 5000.0})  # beyond the window, it is drawn with the last entry
    assert (marked(tab, "emit"), marked(tab, "opac"), marked(tab, "modu")) == (None, near(1.0), None)
    tell(tab, None)
    assert all(marked(tab, which) is None for which in TITLES)


def tell(tab: Tab, values: dict[str, float] | None) -> None:
    """What a viewport tells of what is under the pointer."""
    tab.page.evaluate(
        "(detail) => document.body.dispatchEvent(new CustomEvent('volsplat-value', { bubbles: true, detail }))", values
    )


def marked(tab: Tab, which: str) -> float | None:
    """Where the line for the value in the image stands, as a table position."""
    line = tab.table(which).locator('[data-part="told"]')
    if line.get_attribute("display") == "none":
        return None
    (left, _), (right, _) = tab.place(which, 0, 0), tab.place(which, 1, 0)
    return (box(line)["x"] - left) / (right - left)


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
    points = tab.settles(lambda scene: scene != SCENE).tables.emit.points
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


BAD_NUMBERS = [
    ("opac", "position", "abc", "“abc” is not a number"),
    ("opac", "position", "", "“” is not a number"),
    ("opac", "position", "2000", "must lie between −490 and 1040"),
    ("opac", "position", "-900", "must lie between −490 and 1040"),
    ("opac", "value", "1.5", "“1.5” is not a number from 0 to 1"),
    ("opac", "value", "-0.1", "“-0.1” is not a number from 0 to 1"),
    ("opac", "value", "NaN", "“NaN” is not a number from 0 to 1"),
    ("emit", "value", "red", "“red” is not a colour: type #rrggbb"),
]


def test_bad_numbers_are_told_at_the_field_and_change_nothing(tab: Tab) -> None:
    for which, name, text, told in BAD_NUMBERS:
        tab.points(which).nth(1).focus()
        shown = tab.field(which, name).input_value()
        tab.types(which, name, text)
        assert tab.complaint(which) == told
        assert tab.field(which, name).get_attribute("aria-invalid") == "true"
        tab.field(which, name).blur()
        assert tab.field(which, name).input_value() == shown
        assert tab.scene == SCENE
        tab.points(which).nth(0).focus()
        assert tab.table(which).get_by_role("alert").count() == 0


# -- other tabs


def test_two_tabs_stay_in_step_and_a_drag_is_not_disturbed(tab: Tab) -> None:
    other = Tab(tab.page.context.new_page(), tab.url).load()
    tab.page.mouse.move(*tab.place("opac", 0.4, 0.5))
    tab.page.mouse.down()
    tab.page.mouse.move(*tab.place("opac", 0.6, 0.9), steps=5)
    tab.waits_for(lambda scene: scene.tables.opac.points[1] == (near(0.6), near(0.9)))
    until(other.page, lambda: "0.9" in (other.points("opac").nth(1).get_attribute("aria-valuetext") or ""))
    other.choose("opac", "Invert")
    tab.waits_for(lambda scene: scene.tables.opac.points[0][1] == 1.0)
    tab.page.mouse.move(*tab.place("opac", 0.5, 0.2), steps=5)
    tab.page.mouse.up()
    tab.waits_for(lambda scene: scene.tables.opac.points == ((0.2, 0.0), (near(0.5), near(0.2)), (0.8, 0.5)))
    until(other.page, lambda: "0.2" in (other.points("opac").nth(1).get_attribute("aria-valuetext") or ""))
