"""Whole tables in a real browser: drawn freehand, made by the menus, or loaded, they change the scene."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest

from support.pages.held_answers import HeldAnswers
from support.pages.tables_page import SCENE, VOLUME
from support.pages.tables_tab import TITLES, Tab, until
from tolerances import FREEHAND_PIXELS, ROUNDING
from volsplat.client.scene.presets import preset_scene
from volsplat.client.ui.tables.table_edits import Table, constant, inverted, mirrored, ramp, steps
from volsplat.client.ui.tables.table_files import table_toml
from volsplat.protocol.description.shading_tables import Field

if TYPE_CHECKING:
    from playwright.sync_api import Page


# -- drawing


def test_a_freehand_curve_becomes_the_table(tab: Tab) -> None:
    tab.page.get_by_label("Opacity: draw freehand").click()
    tab.drag(tab.place("opac", 0.0, 0.9), tab.place("opac", 0.5, 0.1), tab.place("opac", 1.0, 0.7))
    entries = tab.settles(lambda scene: scene != SCENE).tables.opac.entries()
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
    drawn = tab.settles(lambda scene: scene != SCENE).tables.opac.entries()
    before = SCENE.tables.opac.entries()
    for n in [*range(125), *range(156, 256)]:
        assert drawn[n] == pytest.approx(before[n], abs=FREEHAND_PIXELS)
    for n in range(130, 151):
        assert drawn[n] == pytest.approx(0.9, abs=FREEHAND_PIXELS)


def test_a_colours_brightness_or_one_channel_can_be_drawn(tab: Tab) -> None:
    tab.page.get_by_label("Reflected: draw freehand").click()
    tab.drag(tab.place("refl", 0.0, 0.3), tab.place("refl", 1.0, 0.3))
    tables = tab.settles(lambda scene: scene != SCENE).tables
    for colour in tables.refl.entries():
        assert colour == pytest.approx((0.3, 0.3, 0.3), abs=FREEHAND_PIXELS)
    tab.table("refl").get_by_text("green").click()
    tab.drag(tab.place("refl", 0.0, 0.8), tab.place("refl", 1.0, 0.8))
    tables = tab.settles(lambda scene: scene.tables != tables).tables
    for colour in tables.refl.entries():
        assert colour == pytest.approx((0.3, 0.8, 0.3), abs=FREEHAND_PIXELS)


def test_the_pencil_paints_the_strip(tab: Tab) -> None:
    tab.page.get_by_label("Reflected: draw freehand").click()
    tab.field("refl", "paint").fill("#ff0000")
    tab.drag(tab.on_strip("refl", 0.25), tab.on_strip("refl", 0.5))
    entries = tab.settles(lambda scene: scene != SCENE).tables.refl.entries()
    assert entries[96] == pytest.approx((1.0, 0.0, 0.0), abs=ROUNDING)
    assert entries[20] == entries[200] == pytest.approx((0.6, 0.6, 0.6), abs=ROUNDING)


# -- menus


def as_its_first_point(table: Table) -> Table:
    first = table.points[0][1]
    return constant(table, first if isinstance(first, tuple) else (first,))


EDITS: dict[str, Callable[[Table], Table]] = {
    "Mirror": mirrored,
    "Invert": inverted,
    "Ramp up": ramp,
    "Ramp down": lambda table: ramp(table, rising=False),
    "Constant": as_its_first_point,
}


@pytest.mark.parametrize("which", TITLES)
def test_the_menu_edits_the_table(tab: Tab, which: str) -> None:
    for item, edit in EDITS.items():
        expected: Table = edit(getattr(tab.tables, which))
        tab.points(which).first.focus()
        tab.choose(which, item)
        tab.becomes(which, expected)


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
    preset = preset_scene("ct-skin", VOLUME.subject(SCENE.quantise))
    scene = tab.waits_for(lambda scene: scene.tables.emit == preset.tables.emit)
    assert scene.cross_bar.emit == preset.cross_bar.emit == Field.SCREEN_Z
    assert scene.tables == msgspec.structs.replace(SCENE.tables, emit=preset.tables.emit)
    until(tab.page, lambda: "screen z" in tab.table("emit").locator(".vs-table-field").inner_text())


def test_a_whole_preset_keeps_the_view_and_the_picture(tab: Tab) -> None:
    tab.page.get_by_text("Presets").click()
    tab.page.get_by_text("ct-skin").click()
    preset = preset_scene("ct-skin", VOLUME.subject(SCENE.quantise))
    scene = tab.waits_for(lambda scene: scene.tables == preset.tables)
    assert (scene.cross_bar, scene.shading, scene.light) == (preset.cross_bar, preset.shading, preset.light)
    assert (scene.view, scene.image, scene.quantise) == (SCENE.view, SCENE.image, SCENE.quantise)


def test_all_opacities_follow_one_slider(tab: Tab) -> None:
    tab.page.get_by_role("slider", name="greatest opacity").focus()
    for _ in range(10):
        tab.page.keyboard.press("ArrowLeft")
    points = tab.settles(lambda scene: scene.tables.opac.greatest == 0.398).tables.opac.points
    assert [position for position, _ in points] == [position for position, _ in SCENE.tables.opac.points]
    assert points[0][1] == 0.0
    assert points[1][1] == points[2][1]


def test_a_slider_does_not_jump_back_where_the_server_answers_late(browser_page: Page, url: str) -> None:
    answers = HeldAnswers(browser_page)
    tab = Tab(browser_page, url).load("/anew")
    tab.page.get_by_role("slider", name="greatest opacity").focus()
    answers.press_ahead("ArrowLeft", lambda: tab.waits_for(lambda scene: scene.tables.opac.greatest == 0.490))
    tab.waits_for(lambda scene: scene.tables.opac.greatest == 0.457)


# -- files


def test_a_table_is_saved_and_loaded(tab: Tab, tmp_path: Path) -> None:
    with tab.page.expect_download() as download:
        tab.choose("opac", "Save as a file")
    assert download.value.suggested_filename == "opac.toml"
    saved = tmp_path / "opac.toml"
    download.value.save_as(saved)
    assert saved.read_text(encoding="utf-8") == table_toml(SCENE, "opac")
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
