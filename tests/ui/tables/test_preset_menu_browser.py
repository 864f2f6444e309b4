"""The menu of presets in a real browser: what it offers first, what it shows of each, and which one is in force."""

from __future__ import annotations

import io

from PIL import Image

from support.pages.tables_page import SCENE, VOLUME
from support.pages.tables_tab import Tab, until
from volsplat.client.scene.presets import PRESETS, fits

Colour = tuple[int, int, int]


def test_what_suits_the_data_is_offered_first(tab: Tab) -> None:
    open_menu(tab)
    suited = [name for name in PRESETS if fits(name, VOLUME.subject())]
    others = [name for name in PRESETS if name not in suited]
    offered = tab.page.locator(".vs-preset .q-item__label:not(.q-item__label--caption)").all_text_contents()
    assert offered == ["from the data", *suited, *others]
    assert suited and others


def test_the_preset_in_force_is_marked_until_a_table_is_changed(tab: Tab) -> None:
    assert marked(tab) == []
    choose(tab, "ct-skin")
    tab.waits_for(lambda scene: scene.tables != SCENE.tables)
    until(tab.page, lambda: marked(tab) == ["ct-skin"])
    tab.choose("opac", "Invert")
    until(tab.page, lambda: marked(tab) == [])
    tab.page.get_by_label("undo").click()
    until(tab.page, lambda: marked(tab) == ["ct-skin"])


def test_a_preset_that_does_not_suit_the_values_says_why(tab: Tab) -> None:
    choose(tab, "ct-skin")
    tab.waits_for(lambda scene: scene.tables != SCENE.tables)
    assert tab.page.locator(".q-notification").count() == 0
    choose(tab, "labels")
    tab.page.get_by_text("the values here reach 2000").wait_for()


def test_each_preset_shows_its_colours_where_they_are_opaque(tab: Tab) -> None:
    open_menu(tab)
    clear, bone = strip(tab, "ct-bone", 0.05), strip(tab, "ct-bone", 0.9)
    assert is_ivory(bone) and not is_ivory(clear)
    assert clear == strip(tab, "ct-skin", 0.95)  # of the menu itself: nothing is seen there
    spectrum = [strip(tab, "galaxy", position) for position in (0.05, 0.95)]
    assert [colour.index(max(colour)) for colour in spectrum] == [2, 0]


def open_menu(tab: Tab) -> None:
    tab.page.get_by_text("Presets", exact=True).click()
    tab.page.locator(".vs-preset").last.wait_for()
    tab.page.wait_for_function("() => document.querySelector('.q-menu')?.contains(document.activeElement)")


def choose(tab: Tab, name: str) -> None:
    open_menu(tab)
    tab.page.locator(".vs-preset", has_text=name).click()
    tab.page.locator(".vs-preset").first.wait_for(state="hidden")


def marked(tab: Tab) -> list[str]:
    """The presets that the menu shows as in force."""
    open_menu(tab)
    names = tab.page.locator('.vs-preset[aria-current="true"] .q-item__label:not(.q-item__label--caption)')
    found = names.all_text_contents()
    tab.page.keyboard.press("Escape")
    tab.page.locator(".vs-preset").first.wait_for(state="hidden")
    return found


def strip(tab: Tab, name: str, position: float) -> Colour:
    """The colour on the screen at a position of a preset's strip."""
    shot = tab.page.locator(".vs-preset", has_text=name).locator(".vs-preset-strip").screenshot(animations="disabled")
    picture = Image.open(io.BytesIO(shot)).convert("RGB")
    colour = picture.getpixel((round(position * picture.width), picture.height // 2))
    assert isinstance(colour, tuple)
    r, g, b = colour
    return (r, g, b)


def is_ivory(colour: Colour) -> bool:
    r, g, b = colour
    return r > g > b > 120
