"""The page without eyes or a mouse: what Chromium's accessibility tree holds, and what Tab reaches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from support.pages.browser import browser
from support.pages.page_tab import page
from volsplat.client.ui.panels.skip_links import PARTS

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "page"]

MOST_TABS = 10
MOST_STOPS = 400  # of Tab, by far
TO_THE_BEGINNING = """() => {
    document.body.tabIndex = -1;
    document.body.focus();
    document.body.removeAttribute("tabindex");
}"""  # where a fresh page's first Tab starts
OPERATED = {
    "button",
    "radio",
    "slider",
    "switch",
    "textbox",
    "combobox",
    "link",
    "checkbox",
    "application",
    "separator",
    "ColorWell",
}


class Node(NamedTuple):
    role: str
    name: str
    value: Any
    properties: dict[str, Any]


def tree(page: Page) -> list[Node]:
    """All that a screen reader is told of."""
    told = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    return [node_of(node) for node in told if not node.get("ignored")]


def node_of(told: dict[str, Any]) -> Node:
    return Node(
        told["role"]["value"],
        told.get("name", {}).get("value", ""),
        told.get("value", {}).get("value"),
        {one["name"]: one["value"].get("value") for one in told.get("properties", [])},
    )


def stops(page: Page) -> Iterator[Node]:
    """What Tab reaches, once through the whole page."""
    session = page.context.new_cdp_session(page)
    page.evaluate(TO_THE_BEGINNING)
    for _ in range(MOST_STOPS):
        page.keyboard.press("Tab")
        if page.evaluate("() => document.activeElement === document.body"):
            return
        focused = session.send("Runtime.evaluate", {"expression": "document.activeElement"})["result"]["objectId"]
        told = session.send("Accessibility.getPartialAXTree", {"objectId": focused, "fetchRelatives": False})
        yield node_of(told["nodes"][0])
    raise AssertionError("Tab never comes to the page's end")


def test_the_page_has_a_language_one_main_and_headings(page: Page) -> None:
    assert page.evaluate("() => document.documentElement.lang") == "en"
    nodes = tree(page)
    assert [node.role for node in nodes].count("main") == 1
    headings = [(node.properties["level"], node.name) for node in nodes if node.role == "heading"]
    assert headings[0] == (1, "head.nrrd")
    assert {name for level, name in headings if level == 2} >= {"Shading", "View", "Bounds", "Image", "Tables"}
    assert {"banner", "navigation", "complementary", "contentinfo"} <= {node.role for node in nodes}


def test_whatever_can_be_operated_has_a_name_and_sliders_have_values(page: Page) -> None:
    page.keyboard.press("s")
    page.wait_for_function("() => document.querySelectorAll('.vs-slice[data-shown]').length === 3")
    operated = [node for node in tree(page) if node.role in OPERATED]
    assert len(operated) > 100
    assert [node for node in operated if not node.name] == []
    sliders = [node for node in operated if node.role == "slider"]
    assert {"specular power", "bounds on i, lowest", "Opacity, point 1 of 5", "axial slice across k"} <= {
        node.name for node in sliders
    }
    for slider in sliders:
        assert slider.value is not None and slider.properties["valuemin"] < slider.properties["valuemax"]
    page.keyboard.press("s")


# What a slider says in words, and what is shown beside it if it has a row.
SHOWN = """() => {
    const slider = document.activeElement;
    const row = slider.closest(".vs-row");
    const shown = [...(row?.querySelectorAll("input:not([type=range]), .vs-number, output") ?? [])];
    return [slider.getAttribute("aria-valuetext"), shown.map((one) => one.value || one.textContent)];
}"""


def test_whatever_tab_reaches_says_what_it_is_and_sliders_where_they_stand(page: Page) -> None:
    names, wrong = [], []
    for node in stops(page):
        names.append(node.name)
        told = node.role in OPERATED and bool(node.name)
        if node.role == "slider":
            said, beside = page.evaluate(SHOWN)
            told &= node.properties["valuemin"] <= node.value <= node.properties["valuemax"]
            told &= bool(said) and (not beside or said.split()[0] in beside)
            told &= not beside or node.value == pytest.approx(float(said.split()[0]))
        if not told:
            wrong.append(node)
    assert not wrong and len(names) > 100
    over_the_picture = [name for name in names if name.endswith("a handle") or name.startswith("look from the")]
    assert len(over_the_picture) == 2, "the handles are one stop, and the cube's sides another"


def test_a_cut_by_keys_is_undone_at_once_however_long_the_key_was_held(page: Page) -> None:
    from playwright.sync_api import expect

    shown = page.get_by_label("lowest i", exact=True)
    page.locator(".vs-picture").focus()
    page.keyboard.press("Tab")
    expect(page.get_by_role("slider", name="lowest i, a handle")).to_be_focused()
    for _ in range(3):
        page.keyboard.down("ArrowUp")
    page.keyboard.up("ArrowUp")
    expect(shown).to_have_value("3")
    page.keyboard.press("Control+z")
    expect(shown).to_have_value("0")
    expect(page.get_by_role("slider", name="lowest i, a handle")).to_have_attribute("aria-valuetext", "0")


def test_arrows_go_through_a_menu_and_round_it(page: Page) -> None:
    def presses(key: str, *expected: str) -> None:
        for words in expected:
            page.keyboard.press(key)
            page.wait_for_function("(words) => document.activeElement.innerText.includes(words)", arg=words)

    for button, first, second, last in (
        ("save", "image as PNG", "image as EXR", "movie"),
        ("Presets", "from the data", "ct-skin", "seismic"),
        ("Opacity: more", "Ramp up", "Ramp down", "Save as a file"),
    ):
        page.get_by_role("button", name=button).focus()
        page.keyboard.press("Enter")
        menu = page.get_by_role("menu")
        page.wait_for_function("() => document.activeElement.closest('[role=menu]') !== null")
        presses("ArrowDown", first, second)
        presses("ArrowUp", first, last)
        presses("ArrowDown", first)
        page.keyboard.press("Escape")
        menu.wait_for(state="hidden")
        page.keyboard.press("Enter")
        page.wait_for_function("() => document.activeElement.closest('[role=menu]') !== null")
        presses("ArrowUp", last)
        page.keyboard.press("Escape")
        menu.wait_for(state="hidden")


DURATIONS = """() => [...document.querySelectorAll("*")].map((part) => getComputedStyle(part))
    .flatMap((style) => [style.transitionDuration, style.animationDuration].join(", ").split(", "))"""


def test_who_wants_less_motion_sees_none(page: Page) -> None:
    page.get_by_role("button", name="Presets").click()
    page.locator(".vs-preset").last.wait_for()
    page.emulate_media(reduced_motion="no-preference")
    assert set(page.evaluate(DURATIONS)) > {"0s"}
    page.emulate_media(reduced_motion="reduce")
    assert set(page.evaluate(DURATIONS)) == {"0s"}
    page.keyboard.press("Escape")
    page.locator(".vs-preset").first.wait_for(state="hidden")


BACKGROUNDS = """(them) => them.map((one) => getComputedStyle(one).backgroundColor)"""


def test_in_a_persons_own_few_colours_what_is_on_or_chosen_is_seen(page: Page) -> None:
    page.emulate_media(forced_colors="active")
    try:
        chosen = {
            *page.locator(".vs-wire:checked, .vs-step.vs-now, .vs-toggle [aria-pressed=true]").evaluate_all(BACKGROUNDS)
        }
        others = {
            *page.locator(
                ".vs-wire:not(:checked), .vs-step:not(.vs-now), .vs-toggle [aria-pressed=false]"
            ).evaluate_all(BACKGROUNDS)
        }
        assert len(chosen) == 1 and not chosen & others
        tracks = [page.locator(f".vs-switch[aria-checked={on}] .q-toggle__inner").first for on in ("true", "false")]
        on, off = (track.evaluate("(track) => getComputedStyle(track).color") for track in tracks)
        assert on != off and {
            track.evaluate("(track) => getComputedStyle(track).forcedColorAdjust") for track in tracks
        } == {"none"}
    finally:
        page.emulate_media(forced_colors="none")


def test_every_part_is_reached_within_ten_tabs(page: Page) -> None:
    for part, place in PARTS.items():
        page.evaluate(TO_THE_BEGINNING)
        link = page.get_by_role("button", name=f"to the {part}", exact=True)
        for _ in range(MOST_TABS):
            page.keyboard.press("Tab")
            if link.evaluate("(link) => link === document.activeElement"):
                break
        page.keyboard.press("Enter")
        page.wait_for_function("(place) => document.querySelector(place).contains(document.activeElement)", arg=place)
