"""What the page says of a session that has ended and whose servers a person has started, in a real browser."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE, Popen
from typing import TYPE_CHECKING

import pytest
import torch

from support.pages.browser import browser, browser_page
from support.pages.page_tab import canvas, drag, save
from support.pages.viewed import HEAD, Viewed, watched, written
from support.patience import wait_until
from support.programs.programs import Person
from support.scenes.arbitrary import plain_scene
from volsplat.bench.page_drag import REFINED
from volsplat.client.scene.scene_file import scene_from_toml
from volsplat.client.ui.viewing.trouble import BY_BUTTON, BY_HAND

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

# The command, which waits less than a minute for another server in the place of its last.
IMPATIENT = """
from volsplat.client.command.cli import main
from volsplat.client.session.links import server_links
server_links.ANOTHER_SECONDS = 0.5
main()
"""
PROGRAMS = ("splat-server", "mapshade-server")


@contextmanager
def viewed_by_hand(folder: Path) -> Iterator[tuple[Viewed, dict[str, Popen[str]]]]:
    """The command, which shows no volume yet, and its servers by their programs, started as it asks for them."""
    person = Person(folder)
    words = ["view", "--no-browser", "--workers", "1", "--listen", "127.0.0.1:0"]
    command = [sys.executable, "-c", IMPATIENT, *words]
    with Popen(command, cwd=folder, env=person.environment, stdout=PIPE, stderr=PIPE, encoding="utf-8") as process:
        try:
            with watched(process, person) as view:
                wait_until(lambda: view.asks_to_start().keys() == set(PROGRAMS), "asked for servers")
                servers = {program: person.starts(program, *view.asks_to_start()[program]) for program in PROGRAMS}
                try:
                    yield view, servers
                finally:
                    for server in servers.values():
                        server.kill()
                        server.communicate()
        finally:
            process.kill()


@pytest.mark.parametrize("lost", PROGRAMS)
def test_where_servers_were_started_by_hand_the_page_offers_no_button_and_says_what_to_do(
    tmp_path: Path, browser_page: Page, lost: str
) -> None:
    from playwright.sync_api import expect

    page, (name, size) = browser_page, HEAD
    volume = written(tmp_path, name, size)
    with viewed_by_hand(tmp_path) as (view, servers):
        page.goto(view.url)
        page.locator(".vs-open").get_by_role("button", name=volume.name).click()
        page.wait_for_function(f"() => document.title.startsWith({volume.name!r})")
        page.wait_for_function(REFINED)
        before = canvas(page)
        servers[lost].kill()
        told = page.locator(".vs-trouble")
        expect(told).to_contain_text(BY_HAND)
        expect(told).not_to_contain_text(BY_BUTTON)
        drag(page, 40, 10)
        expect(page.locator(".vs-again")).to_have_count(0)
        expect(page.get_by_text("start it again")).to_have_count(0)
        assert torch.equal(canvas(page), before)
        assert scene_from_toml(save(page, "scene as TOML").decode(), plain_scene(), "saved") != plain_scene()
        expect(told).to_contain_text(BY_HAND)
        page.goto("about:blank")
