"""The slider that shifts all tables by density, in a real browser: dragged, let go, taken back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import msgspec
import pytest

from support.pages.browser import close_tab
from support.pages.tables_page import SCENE, WINDOW
from support.pages.tables_tab import TITLES, Tab, box, until
from volsplat.client.ui.tables.table_edits import shifted
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import Tables

if TYPE_CHECKING:
    from playwright.sync_api import Locator

THUMB = 14  # pixels
ONE_PIXEL = 0.01  # of the axis
ROUNDED = 1e-5  # places of points


def place(tab: Tab, by: float) -> tuple[float, float]:
    """Where the slider's thumb lies when it pushes by a share of the axis."""
    slider = box(slider_of(tab))
    travel = slider["width"] - THUMB
    return (slider["x"] + THUMB / 2 + (by + 0.5) * travel, slider["y"] + slider["height"] / 2)


def slider_of(tab: Tab) -> Locator:
    return tab.page.get_by_label("shift of all tables by value")


def told(tab: Tab) -> float:
    return float(tab.page.locator(".vs-shift output").inner_text().replace("−", "-"))


def hold(tab: Tab, *way: float) -> None:
    tab.page.mouse.move(*place(tab, 0.0))
    tab.page.mouse.down()
    for by in way:
        tab.page.mouse.move(*place(tab, by), steps=6)


def first_point(scene: Scene) -> float:
    return scene.tables.opac.points[0][0]


def test_all_tables_by_density_move_together_by_what_is_told(tab: Tab) -> None:
    hold(tab, 0.33, 0.15)  # on the way it does not pass where it ends
    scene = tab.waits_for(lambda scene: first_point(scene) == pytest.approx(0.35, abs=ONE_PIXEL))
    by = first_point(scene) - first_point(SCENE)
    assert told(tab) == pytest.approx(by * (WINDOW[1] - WINDOW[0]), abs=10)
    tables = SCENE.tables
    moved = {which: shifted(getattr(tables, which), by) for which in ("emit", "refl", "opac")}
    assert near(scene.tables, msgspec.structs.replace(tables, **moved))
    tab.page.mouse.up()
    until(tab.page, lambda: told(tab) == 0)
    assert slider_of(tab).input_value() == "0"
    assert tab.scene.tables == scene.tables


def near(found: Tables, expected: Tables, apart: float = ROUNDED) -> bool:
    """Whether all points have the same values, at about the same places."""
    for which in TITLES:
        now, then = getattr(found, which).points, getattr(expected, which).points
        if [value for _, value in now] != [value for _, value in then]:
            return False
        if [at for at, _ in now] != pytest.approx([at for at, _ in then], abs=apart):
            return False
    return True


def test_a_whole_push_is_undone_at_once_and_the_next_begins_there(tab: Tab) -> None:
    hold(tab, 0.3, 0.1)
    tab.page.mouse.up()
    once = tab.settles(lambda scene: first_point(scene) == pytest.approx(0.3, abs=ONE_PIXEL))
    until(tab.page, lambda: told(tab) == 0)
    hold(tab, -0.2, 0.1)
    tab.page.mouse.up()
    tab.settles(lambda scene: first_point(scene) == pytest.approx(0.4, abs=ONE_PIXEL))
    until(tab.page, lambda: not tab.page.get_by_label("undo").is_disabled())
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == once)
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)
    until(tab.page, lambda: tab.page.get_by_label("undo").is_disabled())


def test_what_is_pushed_off_the_axis_comes_back_while_it_is_held(tab: Tab) -> None:
    hold(tab, 0.5)
    tab.waits_for(lambda scene: len(scene.tables.opac.points) < 4 and first_point(scene) > 0.6)
    assert tab.tables.opac.points[-1][0] == 1.0
    tab.page.mouse.move(*place(tab, 0.0), steps=6)
    tab.page.mouse.up()
    until(tab.page, lambda: told(tab) == 0)
    back = tab.settles(lambda scene: len(scene.tables.opac.points) == len(SCENE.tables.opac.points))
    assert near(back.tables, SCENE.tables, ONE_PIXEL)


@contextmanager
def where(tab: Tab, then: str) -> Iterator[Tab]:
    """The tab in which the hand is next."""
    if then == "in the same tab":
        yield tab
    elif then == "after a reload":
        yield tab.load()
    else:
        other = Tab(tab.page.context.new_page(), tab.url).load()
        yield other
        close_tab(other.page)


def brings_back(tab: Tab, by: float) -> None:
    """A push by as much, the other way, leads to where the first one began."""
    hold(tab, -by)
    tab.page.mouse.up()
    back = tab.settles(lambda scene: first_point(scene) < 0.3)
    assert near(back.tables, SCENE.tables, ONE_PIXEL)


@pytest.mark.parametrize("then", ["in the same tab", "after a reload", "in another tab"])
def test_what_one_push_takes_off_the_axis_another_brings_back(tab: Tab, then: str) -> None:
    hold(tab, 0.5)
    tab.page.mouse.up()
    tab.settles(lambda scene: first_point(scene) > 0.6)
    until(tab.page, lambda: told(tab) == 0)
    with where(tab, then) as other:
        brings_back(other, 0.5)


def test_a_push_goes_on_in_another_tab_from_where_undo_and_redo_have_led(tab: Tab) -> None:
    def button(name: str) -> Locator:
        return tab.page.locator(".vs-tables-head").get_by_label(name, exact=True)

    def push() -> Scene:
        before = first_point(tab.scene)
        hold(tab, 0.3)
        tab.page.mouse.up()
        pushed = tab.settles(lambda scene: first_point(scene) > before + 0.2)
        until(tab.page, lambda: told(tab) == 0)
        return pushed

    push()
    pushed = push()
    button("undo").click()
    once = tab.settles(lambda scene: scene != pushed)
    button("redo").click()
    tab.settles(lambda scene: scene == pushed)
    button("undo").click()
    tab.settles(lambda scene: scene == once)
    with where(tab, "in another tab") as other:
        brings_back(other, 0.3)


def test_what_a_push_has_cut_off_that_a_reload_ended_comes_back(tab: Tab) -> None:
    hold(tab, 0.5)
    tab.waits_for(lambda scene: first_point(scene) > 0.6)
    tab.load()
    tab.settles(lambda scene: first_point(scene) > 0.6)
    tab.page.mouse.up()
    brings_back(tab, 0.5)


def test_a_push_that_comes_back_to_where_it_began_ends(tab: Tab) -> None:
    hold(tab, 0.3)
    tab.waits_for(lambda scene: first_point(scene) > 0.4)
    tab.page.mouse.move(*place(tab, 0.3))
    slider = slider_of(tab)
    # Which the hand does not find to the pixel.
    slider.evaluate("(s) => { s.value = '0'; s.dispatchEvent(new Event('input')); }")
    slider.evaluate("(s) => s.dispatchEvent(new PointerEvent('pointerup', { bubbles: true }))")
    tab.settles(lambda scene: near(scene.tables, SCENE.tables))
    tab.page.mouse.up()


def test_a_push_ends_with_the_tab_of_its_hand(tab: Tab) -> None:
    other = Tab(tab.page.context.new_page(), tab.url).load()
    hold(other, 0.3)
    tab.waits_for(lambda scene: first_point(scene) > 0.4)
    assert not tab.state.settled
    close_tab(other.page)
    tab.settles(lambda scene: first_point(scene) > 0.4)


def test_keys_shift_by_steps(tab: Tab) -> None:
    slider_of(tab).focus()
    for _ in range(4):
        tab.page.keyboard.press("ArrowRight")
    tab.waits_for(lambda scene: first_point(scene) == pytest.approx(0.2 + 4 / 510, abs=ROUNDED))


def test_tables_that_shift_are_shown_without_rendering_the_page(tab: Tab) -> None:
    tab.page.evaluate(
        """() => {
            window.updates = [];
            window.socket.onAny((kind) => kind === "update" && window.updates.push(kind));
        }"""
    )
    first = tab.points("opac").first
    before = float(first.get_attribute("cx") or 0)
    hold(tab, 0.05, 0.2)
    tab.waits_for(lambda scene: first_point(scene) == pytest.approx(0.4, abs=ONE_PIXEL))
    until(tab.page, lambda: float(first.get_attribute("cx") or 0) > before + 40)
    assert tab.page.evaluate("window.updates") == []
    tab.page.mouse.up()
