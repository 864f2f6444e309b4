"""Colour maps by name in a real browser: found by a part of the name, and taken by either table of colours or both."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest

from support.pages.tables_page import SCENE
from support.pages.tables_tab import Tab, box, until
from tolerances import ONE_LEVEL
from volsplat.client.scene.colour_maps import COLLECTIONS, colormap, colormap_names, lit_and_glowing
from volsplat.client.ui.tables import colour_map_menu
from volsplat.protocol.description.shading_tables import ColourTable

if TYPE_CHECKING:
    from playwright.sync_api import FloatRect, Locator


def test_a_colour_map_is_found_by_keys_alone_and_undone(tab: Tab) -> None:
    found = opened(tab)
    assert found.count() == len(colormap_names().names)
    tab.page.keyboard.type("VIRIDIS _r")
    until(tab.page, lambda: found.all_inner_texts() == ["viridis_r"])
    tab.page.get_by_text("1 of ").wait_for()
    tab.page.keyboard.press("Enter")
    tables = tab.settles(lambda scene: scene != SCENE).tables
    both = lit_and_glowing(colormap("viridis_r"))
    assert is_near(tables.emit, both.emit) and is_near(tables.refl, both.refl)
    assert (tables.opac, tables.modu) == (SCENE.tables.opac, SCENE.tables.modu)
    assert len(tables.refl.points) < 64  # a person can still move them
    tab.page.keyboard.press("Escape")
    found.first.wait_for(state="hidden")
    assert tab.page.evaluate("document.activeElement.innerText").endswith("Colours")
    tab.page.get_by_label("undo").click()
    tab.waits_for(lambda scene: scene == SCENE)


def test_one_table_takes_a_colour_map_as_it_is(tab: Tab) -> None:
    found = opened(tab)
    tab.page.get_by_label("emitted", exact=True).check()
    found.filter(has_text="inferno").first.click()
    tables = tab.settles(lambda scene: scene != SCENE).tables
    assert is_near(tables.emit, colormap("inferno"))
    assert tables == msgspec.structs.replace(SCENE.tables, emit=tables.emit)


def test_arrows_go_through_the_list_and_stay_in_it(tab: Tab) -> None:
    from playwright.sync_api import expect

    found = opened(tab)
    for key, expected in (("ArrowUp", 0), ("ArrowDown", 1), ("PageDown", 11), ("ArrowUp", 10)):
        tab.page.keyboard.press(key)
        active = found.nth(expected)
        expect(active).to_have_attribute("aria-selected", "true")
        assert tab.page.get_by_role("combobox").get_attribute("aria-activedescendant") == active.get_attribute("id")
    for _ in range(10):
        tab.page.keyboard.press("PageDown")
    place = box(tab.page.get_by_role("listbox", name="colour maps"))
    until(tab.page, lambda: is_within(box(tab.page.locator('[role=option][aria-selected="true"]')), place))
    tab.page.keyboard.type("no such map")
    tab.page.get_by_text("0 of ").wait_for()
    tab.page.keyboard.press("Enter")  # which takes nothing
    tab.page.get_by_role("combobox").fill("magma")
    tab.page.keyboard.press("Enter")
    tab.waits_for(lambda scene: is_near(scene.tables.refl, lit_and_glowing(colormap("magma")).refl))


@pytest.fixture
def no_matplotlib(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    absent = {"matplotlib"}
    monkeypatch.setattr("volsplat.program.extras.find_spec", lambda name: None if name in absent else find_spec(name))
    colour_map_menu.listed.cache_clear()
    yield
    colour_map_menu.listed.cache_clear()


def test_without_matplotlib_it_is_said_how_to_have_it(no_matplotlib: None) -> None:
    listed = colour_map_menu.listed()
    assert not listed["maps"]
    assert "pip install" in listed["notes"][0] and "from a file" in listed["notes"][1]


def test_a_library_that_does_not_load_hides_no_other_map(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "volsplat_hostile_library.py").write_text(
        "raise RuntimeError('made for another one')", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COLLECTIONS, "hostile_", "volsplat_hostile_library")
    names, troubles = colormap_names()
    assert "viridis" in names
    assert any("made for another one" in line and "install it anew" in line for line in troubles)


def opened(tab: Tab) -> Locator:
    """The list's options, once they are there."""
    tab.page.get_by_role("button", name="Colours").focus()
    tab.page.keyboard.press("Enter")
    found = tab.page.get_by_role("option")
    found.first.wait_for()
    until(tab.page, lambda: tab.page.evaluate("document.activeElement.role") == "combobox")
    return found


def is_near(table: ColourTable, wanted: ColourTable) -> bool:
    pairs = zip(table.entries(), wanted.entries(), strict=True)
    return all(abs(a - b) < ONE_LEVEL for one, other in pairs for a, b in zip(one, other, strict=True))


def is_within(one: FloatRect, other: FloatRect) -> bool:
    """Up and down."""
    return other["y"] <= one["y"] and one["y"] + one["height"] <= other["y"] + other["height"]
