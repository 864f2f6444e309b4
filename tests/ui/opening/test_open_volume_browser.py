"""Another volume opened from the page of the real command, by keys and by pointer, with others looking on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import nibabel
import numpy as np
import psutil
import pytest
import torch
from websockets.exceptions import ConnectionClosed

from support.files.dicom_files import numbered, series
from support.pages.browser import browser, browser_page
from support.pages.page_tab import after, canvas, drag, opened
from support.pages.viewed import KeptView, Viewed, viewed
from support.patience import wait_until
from support.programs.forked_programs import forker
from support.programs.server_processes import words_of
from volsplat.bench.page_drag import REFINED
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.viewport.viewport_link import OTHER_VOLUME
from volsplat.deploy.forked_servers import FORK_SERVER

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

__all__ = ["browser", "browser_page"]

SIZE = (24, 28, 26)
SHOWN = "head.nrrd – volsplat"  # at the beginning


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Volumes in a folder and in another below it, a series, and what cannot be opened."""
    root = tmp_path_factory.mktemp("volumes") / "data"
    (root / "molecules").mkdir(parents=True)
    write_volume(root / "head.nrrd", *make_phantom("head", SIZE))
    write_volume(root / "molecules" / "protein.nrrd", *make_phantom("protein", SIZE))
    (root / "damaged.nrrd").write_bytes((root / "head.nrrd").read_bytes()[:200])
    series(root / "scan", numbered(9), SeriesNumber="4", SeriesDescription="T2 AX")
    times = np.stack(
        [np.ones(SIZE, np.float32) * np.arange(SIZE[0], dtype=np.float32)[:, None, None], np.ones(SIZE, np.float32)], -1
    )
    nibabel.save(nibabel.Nifti1Image(times, np.eye(4)), root / "beat.nii")
    (root / "way out").symlink_to(root.parent)
    write_volume(root.parent / "secret.nrrd", *make_phantom("protein", SIZE))
    return root


@pytest.fixture(scope="module")
def kept_view(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[KeptView]:
    with closing(KeptView(tmp_path_factory.mktemp("view"), root / "head.nrrd", "--workers", "1")) as kept:
        yield kept


@pytest.fixture
def page(kept_view: KeptView, view: Viewed, browser_page: Page) -> Iterator[Page]:
    """The page with the first volume; the command is begun anew if a test leaves another one."""
    page = opened(browser_page, view.url)
    yield page
    if page.title() != SHOWN:
        kept_view.close()


def dialog(page: Page) -> Locator:
    return page.locator(".vs-open")


def entry(page: Page, name: str) -> Locator:
    return dialog(page).get_by_role("button", name=name)


def shows(page: Page, name: str) -> None:
    """Wait until the page shows this volume, refined to the end."""
    page.wait_for_function(f"() => document.title.startsWith({name!r})")
    page.wait_for_function(REFINED)


def test_another_volume_is_opened_by_keys_and_every_tab_goes_over_to_it_and_back(view: Viewed, page: Page) -> None:
    from playwright.sync_api import expect

    other = opened(page.context.new_page(), view.url)
    turned = after(page, lambda: drag(page, 60, 20))
    servers = {server.pid for server in view.person.servers()}
    page.keyboard.press("o")
    expect(entry(page, "head.nrrd")).to_contain_text("NRRD")
    expect(dialog(page)).not_to_contain_text("way out")
    expect(dialog(page)).not_to_contain_text("secret")
    entry(page, "molecules").focus()
    page.keyboard.press("Enter")
    expect(entry(page, "..")).to_be_focused()
    page.keyboard.press("Tab")
    expect(entry(page, "protein.nrrd")).to_be_focused()
    page.keyboard.press("Enter")
    for tab in (page, other):
        shows(tab, "protein.nrrd")
        expect(tab.get_by_label("undo", exact=True)).to_be_disabled()
    assert not torch.equal(canvas(page), turned)
    wait_until(lambda: not servers & {one.pid for one in view.person.servers()}, "the first servers end")
    other.keyboard.press("o")
    other.get_by_role("list", name="recent volumes").get_by_role("button", name="head.nrrd").click()
    for tab in (page, other):
        shows(tab, "head.nrrd")
    assert torch.equal(canvas(page), turned), "it is as it was left"


def test_page_down_shows_the_next_time_of_a_series_as_this_one_is_shown(view: Viewed, page: Page) -> None:
    from playwright.sync_api import expect

    page.keyboard.press("o")
    entry(page, "beat.nii").click()
    dialog(page).get_by_role("button", name="volume 0 of 0 to 1").click()
    shows(page, "beat.nii#0")
    turned = after(page, lambda: drag(page, 60, 20))
    page.keyboard.press("PageDown")
    shows(page, "beat.nii#1")
    assert not torch.equal(canvas(page), turned), "it has other values"
    page.keyboard.press("PageUp")
    shows(page, "beat.nii#0")
    assert torch.equal(canvas(page), turned)
    page.keyboard.press("PageUp")
    expect(page.locator(".q-notification")).to_contain_text("this is the first volume here")
    other = opened(page.context.new_page(), view.url)
    with forker().held():
        page.evaluate("() => [1, 2].forEach(() => document.querySelector('.vs-page-down').click())")
        for tab in (page, other):
            expect(tab.get_by_label("picture").get_by_text("opening beat.nii#1")).to_be_visible()
            expect(tab.get_by_label("open the next volume")).to_be_disabled()
            assert left_to_the_browser(tab, "body", "PageDown")
        other.get_by_role("button", name="cancel").click()
        expect(page.locator(".q-notification")).to_contain_text(["this is the first", "it was given up"])
    expect(page.locator(".q-notification.bg-negative")).to_have_count(0)
    expect(page.get_by_label("picture").get_by_text("opening beat.nii#1")).to_be_hidden()
    assert page.title() == "beat.nii#0 – volsplat"


def test_page_keys_are_obeyed_once_while_they_are_held_and_not_where_the_focus_is_in_a_panel(page: Page) -> None:
    page.evaluate("""() => {
        window.presses = 0;
        document.querySelector(".vs-page-down").addEventListener("click", () => { window.presses += 1; });
    }""")
    assert left_to_the_browser(page, ".vs-left [role=slider]", "PageDown")
    assert page.evaluate("window.presses") == 0
    for _ in range(3):
        page.keyboard.down("PageDown")
    page.keyboard.up("PageDown")
    assert page.evaluate("window.presses") == 1


def left_to_the_browser(page: Page, selector: str, key: str) -> bool:
    """Whether a key that is pressed there does what it does on every page."""
    pressed = (
        "(there, key) => there.dispatchEvent(new KeyboardEvent('keydown', {key, bubbles: true, cancelable: true}))"
    )
    return bool(page.locator(selector).first.evaluate(pressed, key))


def test_a_series_is_found_by_its_description_and_a_name_by_a_part_of_it(page: Page) -> None:
    from playwright.sync_api import expect

    page.get_by_role("button", name="open another volume").click()
    dialog(page).get_by_label("part of a name").fill("SCA")
    expect(entry(page, "head.nrrd")).to_have_count(0)
    entry(page, "scan").click()
    entry(page, "T2 AX").click()
    shows(page, "scan")


def test_a_refusal_is_one_line_in_the_dialog_and_the_volume_is_drawn_on(page: Page) -> None:
    from playwright.sync_api import expect

    before = canvas(page)
    page.keyboard.press("o")
    entry(page, "damaged.nrrd").click()
    alert = dialog(page).get_by_role("alert")
    expect(alert).to_contain_text("damaged.nrrd")
    assert "\n" not in (alert.text_content() or "")
    expect(entry(page, "head.nrrd")).to_be_enabled()
    page.keyboard.press("Escape")
    expect(dialog(page)).to_be_hidden()
    assert torch.equal(canvas(page), before)
    assert not torch.equal(after(page, lambda: drag(page, 60, 20)), before)


def test_while_one_is_opened_all_tabs_say_so_the_old_one_turns_and_any_tab_gives_it_up(
    view: Viewed, page: Page
) -> None:
    from playwright.sync_api import expect

    other = opened(page.context.new_page(), view.url)
    servers = running(view)
    for tab in (page, other):
        tab.keyboard.press("o")
        expect(entry(tab, "molecules")).to_be_visible()
    with forker().held():
        entry(page, "molecules").click()
        entry(page, "protein.nrrd").click()
        new = started(view, servers)
        for tab in (page, other):
            expect(dialog(tab).get_by_role("status")).to_contain_text("opening molecules/protein.nrrd")
        expect(entry(other, "head.nrrd")).to_be_disabled()
        page.keyboard.press("Escape")
        expect(dialog(page)).to_be_hidden()
        before = canvas(page)
        assert not torch.equal(after(page, lambda: drag(page, 60, 20)), before)
        dialog(other).get_by_role("button", name="cancel").click()
        expect(entry(other, "head.nrrd")).to_be_enabled()
        page.keyboard.press("o")
        expect(dialog(page).get_by_role("alert")).to_be_hidden()
        wait_until(lambda: not any(server.is_running() for server in new), "the new servers end")
    assert page.title() == other.title() == SHOWN


def test_servers_that_are_lost_while_one_is_opened_are_replaced(view: Viewed, page: Page) -> None:
    servers = running(view)
    page.keyboard.press("o")
    with forker().held():
        entry(page, "molecules").click()
        entry(page, "protein.nrrd").click()
        for server in started(view, servers):
            server.kill()
    shows(page, "protein.nrrd")
    with view.viewport("away&volume=1") as of_before, pytest.raises(ConnectionClosed) as closed:
        of_before.hears()
    assert closed.value.rcvd is not None and closed.value.rcvd.code == OTHER_VOLUME, "a tab that missed it is told"


def started(view: Viewed, before: set[int]) -> list[psutil.Process]:
    """What new servers are to be forked from."""

    def new() -> list[psutil.Process]:
        below = psutil.Process(view.process.pid).children()
        return [one for one in below if one.pid not in before and FORK_SERVER in words_of(one)]

    wait_until(lambda: bool(new()), "new servers start")
    return new()


def running(view: Viewed) -> set[int]:
    return {one.pid for one in psutil.Process(view.process.pid).children()}


def test_nothing_above_the_root_of_the_command_line_is_opened(root: Path, tmp_path: Path, browser_page: Page) -> None:
    from playwright.sync_api import expect

    with viewed(tmp_path, root / "head.nrrd", "--workers", "1", "--root", str(root / "molecules")) as running:
        page = opened(browser_page, running.url)
        page.keyboard.press("o")
        expect(dialog(page)).to_contain_text("molecules")
        expect(entry(page, "..")).to_have_count(0)
        entry(page, "protein.nrrd").click()
        shows(page, "protein.nrrd")
        page.keyboard.press("o")
        expect(entry(page, "protein.nrrd")).to_be_visible()
        expect(entry(page, "head.nrrd")).to_have_count(0)  # the way back would lead out
