"""Figures on the page, and the picture as one: its colours, alone on the screen, on the clipboard."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from support.pages.browser import browser, browser_page
from support.pages.page_tab import fresh_page, page
from support.pages.tables_tab import box
from support.pages.viewed import phantom, view, volume
from volsplat.client.figure.figure import Figure
from volsplat.protocol.description.scene import Image

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

__all__ = ["browser", "browser_page", "fresh_page", "page", "phantom", "view", "volume"]

CLIPBOARD = """async () => {
  const [item] = await navigator.clipboard.read();
  const bitmap = await createImageBitmap(await item.getType("image/png"));
  const canvas = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height });
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
  return canvas.toDataURL();
}"""


def test_a_figure_is_made_of_the_picture_as_it_stands(page: Page) -> None:
    page.get_by_role("button", name="save").click()
    page.get_by_text("figure…").click()
    make = page.get_by_role("button", name="make the figure")
    page.get_by_label("pixels per inch").fill("5")
    make.click()
    page.get_by_text("figure: dpi must be 20 to 2400 pixels per inch").wait_for()
    page.get_by_label("pixels per inch").fill("100")
    page.get_by_label("labels, each TEXT@I,J,K").fill("nose")
    make.click()
    page.get_by_text("labels: give TEXT@I,J,K in each line").wait_for()
    page.get_by_label("labels, each TEXT@I,J,K").fill("nose@12,1,14\nall@12,16,14")
    page.get_by_label("width, cm").fill("2.54")
    page.get_by_label("title", exact=True).fill("A small head")
    page.get_by_label("kind").click()
    page.get_by_role("option", name=".svg").click()
    with page.expect_download() as download:
        make.click()
    assert download.value.suggested_filename == "head.svg"
    root = ElementTree.parse(Path(download.value.path())).getroot()
    assert root.attrib["width"] == "1in"
    texts = [element.text for element in root.iter() if element.text]
    assert {"A small head", "nose", "all", "R", "L", "S", "I"} <= set(texts)
    assert page.get_by_text("figure: dpi").count() == 0
    lacks = page.get_by_text("the figure lacks the label away: what it points at lies outside the picture")
    assert lacks.count() == 0
    page.get_by_label("labels, each TEXT@I,J,K").fill("nose@12,1,14\naway@900,900,900")
    with page.expect_download():
        make.click()
    lacks.wait_for()
    page.get_by_label("width, cm").fill("")
    page.get_by_label("pixels per inch").fill("")
    with page.expect_download() as download:
        make.click()
    root = ElementTree.parse(Path(download.value.path())).getroot()
    (picture,) = root.findall(".//{*}image")
    (side,) = (text for text in root.findall(".//{*}text") if text.text == "R")
    image = Image(width=round(float(picture.attrib["width"])), height=round(float(picture.attrib["height"])))
    assert float(side.attrib["font-size"]) == Figure().em_on(image), "nobody said how large it is printed"
    page.get_by_role("button", name="close", exact=True).click()
    make.wait_for(state="hidden")


def bottom(shown: Locator) -> float:
    place = box(shown)
    return place["y"] + place["height"]


def test_colours_are_shown_over_the_picture_and_stay_so(page: Page) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    colours = page.locator(".vs-colours")
    assert colours.is_hidden()
    page.keyboard.press("c")
    colours.wait_for()
    assert "value; curve: opacity, 0 to 0.95" in colours.inner_text()
    page.reload()
    colours.wait_for()
    page.get_by_role("button", name="copy the picture").click()
    said = page.get_by_text("The picture is on the clipboard.")
    said.wait_for()
    assert box(said)["y"] >= bottom(colours)
    page.get_by_role("button", name="three slices").click()
    page.locator(".vs-slice").first.wait_for()
    bar, picture = box(colours), box(page.locator(".vs-viewport"))
    assert bar["x"] + bar["width"] <= picture["x"] + picture["width"]
    assert bar["y"] >= bottom(page.locator(".vs-picture-buttons"))
    page.get_by_role("button", name="colours of the tables").click()
    colours.wait_for(state="hidden")


def test_the_picture_is_alone_until_a_key_brings_the_panels_back(page: Page) -> None:
    panels = [page.locator(place) for place in (".vs-head", ".vs-left", ".vs-right", ".vs-foot")]
    wide = page.evaluate("volsplatViewport.canvas.clientWidth")
    page.keyboard.press("p")
    for panel in panels:
        panel.wait_for(state="hidden")
    page.wait_for_function(f"volsplatViewport.canvas.width > {wide}")
    page.get_by_role("button", name="the picture alone").click()
    for panel in panels:
        panel.wait_for()


def test_the_picture_is_copied_as_it_is_on_the_screen(page: Page) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.keyboard.press("Control+c")
    page.get_by_text("The picture is on the clipboard.").wait_for()
    assert page.evaluate(CLIPBOARD) == page.evaluate("volsplatViewport.canvas.toDataURL()")


def test_a_browser_that_refuses_a_copy_is_cited_with_what_to_do_instead(page: Page) -> None:
    page.context.clear_permissions()
    page.get_by_role("button", name="copy the picture").click()
    page.get_by_text(re.compile(r"The picture could not be copied: .*[^.]; save it instead\.$")).wait_for()


def test_without_a_clipboard_copies_are_refused_in_words(fresh_page: Page) -> None:
    page = fresh_page
    page.evaluate("Object.defineProperty(navigator, 'clipboard', { value: undefined })")
    page.get_by_role("button", name="copy the picture").click()
    page.get_by_text("save the picture instead").wait_for()
    page.get_by_role("button", name="save").click()
    page.get_by_text("copy a link").click()
    page.get_by_text("save the scene as TOML instead").wait_for()
