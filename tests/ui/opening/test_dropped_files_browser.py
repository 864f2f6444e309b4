"""Files dropped on the page by the browser itself, which would show them in the page's place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from support.pages.browser import browser, browser_page
from support.pages.page_tab import after, canvas, opened, save
from support.pages.viewed import Viewed, viewed
from volsplat.bench.page_drag import REFINED
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

SIZE = (24, 28, 26)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("volumes") / "data"
    (root / "molecules").mkdir(parents=True)
    write_volume(root / "head.nrrd", *make_phantom("head", SIZE))
    write_volume(root / "molecules" / "protein.nrrd", *make_phantom("protein", SIZE))
    return root


@pytest.fixture(scope="module")
def view(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewed]:
    with viewed(tmp_path_factory.mktemp("view"), root / "head.nrrd", "--workers", "1") as running:
        yield running


def drop(page: Page, *paths: Path) -> None:
    """As a hand does it: the browser reads the files itself, and leaves the page unless that takes them."""
    devtools = page.context.new_cdp_session(page)
    data = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        devtools.send("Input.dispatchDragEvent", {"type": kind, "x": 640, "y": 400, "data": data})
        if kind == "dragOver":
            page.locator(".vs-dropping").wait_for()
    page.locator(".vs-dropping").wait_for(state="hidden")


def test_a_dropped_scene_or_saved_picture_is_seen_and_what_holds_none_is_told(
    view: Viewed, browser_page: Page, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    page = opened(browser_page, view.url)
    blue, plain, bad = (tmp_path / name for name in ("blue.toml", "saved.png", "strange.png"))
    plain.write_bytes(save(page, "image as PNG"))
    scene = save(page, "scene as TOML").decode()
    blue.write_text(scene.replace('background = "#000000"', 'background = "#204060"'))
    bad.write_bytes(plain.read_bytes()[:40])
    assert after(page, lambda: drop(page, blue))[0, 0, :3].tolist() == [0x20, 0x40, 0x60]
    assert after(page, lambda: drop(page, plain))[0, 0, :3].tolist() == [0, 0, 0]
    shown = canvas(page)
    drop(page, bad)
    told = page.get_by_text("strange.png: ")
    expect(told).to_be_visible()
    assert "volsplat-" not in (told.text_content() or ""), "not the path of a copy"
    assert canvas(page).equal(shown)


def test_a_dropped_volume_is_offered_by_its_name_where_the_servers_see_one(
    view: Viewed, browser_page: Page, root: Path, tmp_path: Path
) -> None:
    from playwright.sync_api import expect

    page = opened(browser_page, view.url)
    dialog, address = page.locator(".vs-open"), page.url
    (tmp_path / "scan").mkdir()
    (tmp_path / "other.mha").write_text("anywhere else")
    for path in (tmp_path / "other.mha", tmp_path / "scan"):
        drop(page, path)
        expect(dialog.get_by_role("alert")).to_contain_text(f"no {path.name} in data. A browser does not tell")
        expect(dialog.get_by_role("button", name="molecules")).to_be_visible()
    drop(page, tmp_path / "other.mha", tmp_path / "scan")
    expect(page.get_by_text("2 files were dropped")).to_be_visible()
    drop(page, root / "molecules")
    expect(dialog).to_contain_text("is it this molecules?")
    dialog.get_by_role("button", name="molecules").click()
    dialog.get_by_role("button", name="protein.nrrd").click()
    page.wait_for_function("() => document.title.startsWith('protein.nrrd')")
    page.wait_for_function(REFINED)
    drop(page, root / "head.nrrd")
    expect(dialog.get_by_role("button", name=re.compile("NRRD"))).to_have_count(1)
    dialog.get_by_role("button", name="head.nrrd").click()
    page.wait_for_function("() => document.title.startsWith('head.nrrd')")
    page.wait_for_function(REFINED)
    assert page.url == address, "the page was never left"


def test_where_no_volume_is_shown_yet_its_file_is_looked_for_and_a_scene_must_wait(
    root: Path, tmp_path: Path, browser_page: Page
) -> None:
    from playwright.sync_api import expect

    scene = tmp_path / "look.toml"
    scene.write_text("")
    with viewed(root, None, "--workers", "1") as running:
        page = browser_page
        page.goto(running.url)
        expect(page.locator(".vs-open").get_by_role("button", name="head.nrrd")).to_be_visible()
        drop(page, scene)
        expect(page.get_by_text("look.toml: a scene needs a volume")).to_be_visible()
        drop(page, root / "head.nrrd")
        expect(page.locator(".vs-open")).to_contain_text("is it this head.nrrd?")
        page.locator(".vs-open").get_by_role("button", name="head.nrrd").click()
        page.wait_for_function("() => document.title.startsWith('head.nrrd')")
