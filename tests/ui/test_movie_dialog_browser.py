"""The page's dialog for movies, in a real browser: what it refuses, what it makes, and the volume beside it."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest
import torch

from support.pages.browser import browser, browser_page
from support.pages.page_tab import after, canvas, drag, opened
from support.pages.viewed import Viewed

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

__all__ = ["browser", "browser_page"]

pytestmark = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="films need ffmpeg: apt install ffmpeg")


@pytest.fixture
def page(view: Viewed, browser_page: Page) -> Page:
    """The page with the dialog open."""
    page = opened(browser_page, view.url)
    page.get_by_role("button", name="save").click()
    page.get_by_text("movie…").click()
    page.get_by_text("make the movie").wait_for()
    return page


def labelled(page: Page, field: str) -> Locator:
    return page.get_by_label({"width": "width, pixels", "height": "height, pixels"}.get(field, field), exact=True)


def fill(page: Page, **fields: str) -> None:
    for field, text in fields.items():
        labelled(page, field).fill(text)


def made(page: Page, folder: Path) -> dict[str, Any]:
    """The movie that the browser saves: its name, and what ffprobe finds in it."""
    with page.expect_download() as download:
        page.get_by_text("make the movie").click()
    assert download.value.url.startswith("http")  # it is no message of the page's socket
    path = folder / download.value.suggested_filename
    shutil.copy(download.value.path(), path)
    asked = ["ffprobe", "-v", "error", "-count_packets", "-show_streams", "-of", "json", str(path)]
    (stream,) = json.loads(subprocess.run(asked, check=True, capture_output=True).stdout)["streams"]
    return {"name": path.name, **stream}


def test_a_movie_has_the_count_size_and_name_that_were_asked_for(page: Page, tmp_path: Path) -> None:
    fill(page, images="4", width="64", height="48", name="my head")
    movie = made(page, tmp_path)
    assert movie["name"] == "my head.mp4"
    assert (movie["width"], movie["height"], movie["nb_read_packets"]) == (64, 48, "4")
    page.get_by_text("4 images in my head.mp4").wait_for()


def test_escape_closes_the_dialog_but_first_the_menu_that_is_open_in_it(page: Page) -> None:
    page.get_by_label("kind").click()
    kinds = page.get_by_role("option")
    kinds.first.wait_for()
    page.keyboard.press("Escape")
    kinds.first.wait_for(state="hidden")
    make = page.get_by_text("make the movie")
    assert make.is_visible()
    page.keyboard.press("Escape")
    make.wait_for(state="hidden")
    page.wait_for_function("() => document.activeElement.ariaLabel === 'save'")


COUNT = "images: give a whole number from 2 to 10000"
NAME = "name: give one of more than blanks that does not begin with a dot, without slashes"
# No two in a row are told alike, so that each answer is seen to be a new one.
REFUSED = [
    ("images", "0", COUNT),
    ("name", "../head", NAME),
    ("images", "1", COUNT),
    ("width", "8", "width, pixels: give a whole number from 16 to 16384"),
    ("images", "-5", COUNT),
    ("images a second", "0", "images a second: give a whole number from 1 to 120"),
    ("images", "99999", COUNT),
    ("name", "", NAME),
    ("name", "😀" * 100, "name: it takes 404 bytes with .mp4, and a file's takes 255 at most; give a shorter one"),
    ("name", "   ", NAME),
    ("images", "", COUNT),
]


def test_what_makes_no_movie_is_refused_in_words(page: Page) -> None:
    for field, text, told in REFUSED:
        good = labelled(page, field).input_value()
        fill(page, **{field: text})
        page.get_by_text("make the movie").click()
        page.get_by_text(told).wait_for()
        assert page.get_by_role("button", name="cancel").is_hidden()
        fill(page, **{field: good})


def test_a_name_may_be_as_long_as_a_file_s(page: Page, tmp_path: Path) -> None:
    name = "頭" * 83 + "ab"  # 251 bytes, and the ending's 4
    fill(page, images="2", width="16", height="16", name=name)
    with page.expect_download() as download:
        page.get_by_text("make the movie").click()
    page.get_by_text(f"2 images in {name}.mp4").wait_for()
    assert download.value.path().read_bytes()[4:8] == b"ftyp"


def test_key_scenes_are_wanted_before_a_flight(page: Page) -> None:
    page.get_by_role("button", name="key scenes").click()
    page.get_by_text("make the movie").click()
    page.get_by_text("cannot pass through 0 key scenes").wait_for()


def test_while_a_movie_is_made_the_volume_can_be_turned_and_no_picture_of_the_movie_is_another(
    view: Viewed, page: Page
) -> None:
    fill(page, images="120", width="128", height="96")
    with page.expect_download() as download:
        page.get_by_text("make the movie").click()
        page.get_by_text(re.compile(r"image \d+ of 120")).wait_for()
        (encoder,) = [one for one in psutil.Process(view.process.pid).children() if one.name() == "ffmpeg"]
        encoder.suspend()  # however slowly the page is drawn, the movie is not there before
        turned = [after(page, lambda: drag(page, 40, 10))]
        assert page.get_by_role("button", name="cancel").is_visible()  # it is still being made
        encoder.resume()
        turned += [after(page, lambda: drag(page, 40, 10)) for _ in range(2)]
    assert not torch.equal(turned[0], turned[1]) and not torch.equal(turned[1], turned[2])
    assert torch.equal(canvas(page), turned[2])
    assert download.value.path().read_bytes()[4:8] == b"ftyp"


def test_a_movie_is_cancelled(page: Page) -> None:
    fill(page, images="5000")
    page.get_by_text("make the movie").click()
    page.get_by_text(re.compile(r"image \d+ of 5000")).wait_for()
    page.get_by_role("button", name="cancel").click()
    page.get_by_text("cancelled").wait_for()
    before = canvas(page)
    assert not torch.equal(after(page, lambda: drag(page, 30, 0)), before)
