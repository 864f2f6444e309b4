"""`volsplat view` without a volume: the page asks which one to open, by servers started here or by hand."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from support.pages.browser import browser, browser_page
from support.pages.viewed import Viewed, viewed
from support.patience import PATIENCE
from support.programs.clusters import cluster_file, sshd
from support.programs.programs import Person
from volsplat.bench.page_drag import REFINED
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.opening.phantom_files import PHANTOMS, PhantomFiles
from volsplat.protocol.messages.folder_messages import MOST_ENTRIES
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

__all__ = ["browser", "browser_page"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A volume among more than can be told that have its name in theirs; another in a folder; a damaged one."""
    root = tmp_path_factory.mktemp("volumes")
    write_volume(root / "zz.nrrd", *make_phantom("head", (16, 18, 20)))
    for number in range(MOST_ENTRIES + 1):
        (root / f"a{number}-zz.nrrd").symlink_to("zz.nrrd")
    (root / "few").mkdir()
    write_volume(root / "few" / "protein.nrrd", *make_phantom("protein", (16, 18, 20)))
    write_volume(root / "few" / "second.nrrd", *make_phantom("head", (16, 18, 20)))
    (root / "few" / "damaged.nrrd").write_bytes((root / "zz.nrrd").read_bytes()[:200])
    return root


def start(page: Page, url: str) -> Locator:
    page.goto(url)
    return page.locator(".vs-open")


def entry(page: Page, name: str) -> Locator:
    return page.locator(".vs-open").get_by_role("button", name=name, exact=False)


def shows(page: Page, name: str) -> None:
    page.wait_for_function(f"() => document.title.startsWith({name!r})", timeout=PATIENCE * 1000)
    page.wait_for_function(REFINED, timeout=PATIENCE * 1000)


def test_the_page_asks_and_every_tab_goes_over_to_the_phantom_that_is_chosen(root: Path, browser_page: Page) -> None:
    from playwright.sync_api import expect

    with viewed(root / "few", None, "--workers", "1", "--preset", "surfaces") as running:
        page, other = browser_page, browser_page.context.new_page()
        start(page, running.url)
        start(other, running.url)
        expect(entry(page, "protein.nrrd")).to_be_visible()
        expect(page.get_by_role("heading", name="Open a volume")).to_be_visible()
        entry(page, "phantoms").click()
        entry(page, "marschner-lobb").click()
        for tab in (page, other):
            shows(tab, "marschner-lobb.nrrd")
        page.keyboard.press("o")
        entry(page, "protein.nrrd").click()
        shows(page, "protein.nrrd")


def test_a_path_that_is_typed_opens_what_a_list_cannot_show(root: Path, browser_page: Page) -> None:
    from playwright.sync_api import expect

    with viewed(root, None, "--workers", "1") as running:
        page, dialog = browser_page, start(browser_page, running.url)
        typed = dialog.get_by_label("part of a name")
        expect(dialog).to_contain_text("more are there")
        for wrong in ("few/none.nrrd", "../elsewhere.nrrd", "few/damaged.nrrd"):
            typed.fill(wrong)
            typed.press("Enter")
            expect(dialog.get_by_role("alert")).to_contain_text(wrong)
        typed.fill("few")
        typed.press("Enter")
        expect(entry(page, "protein.nrrd")).to_be_visible()
        typed.fill("d.n")
        expect(entry(page, "protein.nrrd")).to_have_count(0)
        typed.press("Enter")
        expect(dialog.get_by_role("alert")).to_have_text(
            "d.n: 2 have it in their names; type more of it, or choose one"
        )
        expect(entry(page, "second.nrrd")).to_be_visible()
        typed.fill("DAM")
        expect(dialog.get_by_role("alert")).to_have_text("")
        typed.press("Enter")
        expect(dialog.get_by_role("alert")).to_contain_text("damaged.nrrd")
        typed.fill("../zz.nrrd")
        typed.press("Enter")
        shows(page, "zz.nrrd")


def test_parts_of_a_file_are_shown_and_one_is_opened(tmp_path: Path, browser_page: Page) -> None:
    values = make_phantom("head", (16, 18, 20))[0].numpy()
    np.savez(tmp_path / "pair.npz", whole=values, cut=values[:12])
    np.savez(tmp_path / "single.npz", only=values)
    with viewed(tmp_path, None, "--workers", "1") as running:
        page = browser_page
        start(page, running.url)
        entry(page, "pair.npz").click()
        entry(page, "cut 12 x 18 x 16").click()
        shows(page, "pair.npz")
        page.keyboard.press("o")
        entry(page, "single.npz").click()
        shows(page, "single.npz")


def test_servers_of_a_cluster_tell_what_they_see_and_draw_what_is_chosen(
    root: Path, tmp_path: Path, browser_page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with sshd(tmp_path / "sshd") as machine:
        machine += f'threads = 1\ndata-root = "{root}"\nmap-shade-servers = 2\nsplat-servers = 1\n'
        cluster = cluster_file(tmp_path, f"page-{os.getpid()}", machine)
        with viewed(tmp_path, None, "--cluster", str(cluster), "--root", str(root / "few")) as running:
            page, dialog = browser_page, start(browser_page, running.url)
            for name in ("second.nrrd", "protein.nrrd"):
                entry(page, name).click()
                shows(page, name)
                expect(page.locator(".vs-picture")).to_be_visible()
                page.keyboard.press("o")
            entry(page, "damaged.nrrd").click()
            expect(dialog.get_by_role("alert")).to_contain_text("damaged.nrrd")
            shows(page, "protein.nrrd")
    assert "is not up" in Person(tmp_path).runs("deploy", "status", str(cluster)).stderr


def test_servers_started_by_hand_tell_what_they_see_and_go_on_from_volume_to_volume(
    root: Path, tmp_path: Path, browser_page: Page
) -> None:
    from playwright.sync_api import expect

    (tmp_path / "seen by nobody.nrrd").symlink_to(root / "zz.nrrd")
    with viewed(tmp_path, None, "--workers", "1", "--listen", "127.0.0.1:0") as running:
        page, dialog = browser_page, start(browser_page, running.url)
        expect(dialog).to_contain_text("waiting for a map/shade server")
        with joined(running, root / "few"):
            entry(page, "protein.nrrd").click()
            shows(page, "protein.nrrd")
            page.keyboard.press("o")
            expect(entry(page, "seen by nobody")).to_have_count(0)
            entry(page, "damaged.nrrd").click()
            expect(dialog.get_by_role("alert")).to_contain_text("damaged.nrrd")
            shows(page, "protein.nrrd")
            entry(page, "second.nrrd").click()
            shows(page, "second.nrrd")


@contextmanager
def joined(running: Viewed, folder: Path) -> Iterator[None]:
    """The servers that the command asked for, started in a folder; they end by themselves."""
    wanted = running.asks_to_start()
    assert wanted.keys() == {"splat-server", "mapshade-server"}
    beside = Person(folder)
    beside.token = running.person.token
    started = [beside.starts(program, *options) for program, options in wanted.items()]
    try:
        yield
        running.process.send_signal(signal.SIGINT)
        assert [server.wait(PATIENCE) for server in started] == [0, 0]
    finally:
        for server in started:
            server.kill()
            server.communicate()


def test_what_is_listed_can_be_made_and_what_is_given_up_is_not(tmp_path: Path) -> None:
    from volsplat.client import phantoms

    files = PhantomFiles(lambda: tmp_path)
    assert set(PHANTOMS) <= set(phantoms.PHANTOMS) and files.names == list(PHANTOMS)
    with pytest.raises(BadInput, match="given up"):
        files.made("head", lambda: True)
    assert not list(tmp_path.iterdir())
    path = Path(files.made("marschner-lobb", lambda: False))
    assert path.parent == tmp_path and path.stat().st_size > 41**3
    with pytest.raises(BadInput, match="no such phantom"):
        files.made("nobody", lambda: False)
