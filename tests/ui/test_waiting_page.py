"""What the browser shows while the volume is not there yet, and that the page itself follows."""

from __future__ import annotations

import shlex
import signal
import sys
from pathlib import Path

import pytest
from playwright.sync_api import Page

from support.pages import patient_http
from support.pages.browser import browser, browser_page
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume

__all__ = ["browser", "browser_page"]


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Person:
    """Someone with a volume `head.nrrd`, whose browser notes the addresses that it is to open."""
    write_volume(tmp_path / "head.nrrd", *make_phantom("head", (24, 32, 28)))
    note = tmp_path / "browser.py"
    note.write_text(f"import sys; open({str(tmp_path / 'opened')!r}, 'a').write(sys.argv[1] + '\\n')")
    monkeypatch.setenv("BROWSER", f"{shlex.join([sys.executable, str(note)])} %s")
    return Person(tmp_path)


def opened_addresses(person: Person) -> list[str]:
    """What the browser was to open, once it was."""
    path = person.folder / "opened"
    wait_until(lambda: path.exists() and path.read_text(encoding="utf-8").endswith("\n"), "opened")
    return path.read_text(encoding="utf-8").splitlines()


def test_no_command_line_holds_what_opens_the_page(person: Person, browser_page: Page) -> None:
    words, _ = listening(person)
    view = person.starts(*words)
    try:
        (address,) = opened_addresses(person)
        redirect = Path(address.removeprefix("file://"))
        assert redirect.stat().st_mode & 0o777 == 0o600
        assert view.stderr is not None
        browser_page.goto(address)
        browser_page.get_by_text("waiting for servers").wait_for()
        assert not redirect.exists()
        assert "token" not in browser_page.url
        view.send_signal(signal.SIGINT)
        view.communicate(timeout=PATIENCE)
    finally:
        view.kill()
        view.communicate()


def test_a_redirect_file_that_nobody_opened_is_gone_at_the_end(person: Person) -> None:
    words, _ = listening(person)
    view = person.starts(*words)
    try:
        (address,) = opened_addresses(person)
        view.send_signal(signal.SIGTERM)
        _, said = view.communicate(timeout=PATIENCE)
    finally:
        view.kill()
        view.communicate()
    assert not Path(address.removeprefix("file://")).exists(), (view.returncode, said)


def listening(person: Person) -> tuple[list[str], str]:
    """A command's words that lets it wait for servers, and where it waits."""
    place = f"127.0.0.1:{free_port()}"
    return ["view", "head.nrrd", "--workers", "1", "--listen", place], place


def test_the_browser_tells_what_is_waited_for_and_then_shows_the_page(person: Person, browser_page: Page) -> None:
    words, place = listening(person)
    view = person.starts(*words)
    try:
        (address,) = opened_addresses(person)
        browser_page.goto(address)
        browser_page.get_by_text("waiting for servers: 0 of 1 map/shade servers").wait_for()
        assert browser_page.title() == "head.nrrd – volsplat"
        servers = [person.starts(name, "--connect", place) for name in ("splat-server", "mapshade-server")]
        browser_page.wait_for_function("() => window.volsplatViewport?.log.at(-1)?.last")
        assert opened_addresses(person) == [address]
        view.send_signal(signal.SIGINT)
        view.communicate(timeout=PATIENCE)
        for server in servers:
            server.communicate(timeout=PATIENCE)
    finally:
        view.kill()
        view.communicate()


def test_nothing_is_told_without_the_token_and_ctrl_c_ends_it(person: Person, browser_page: Page) -> None:
    words, _ = listening(person)
    view = person.starts(*words)
    try:
        (address,) = opened_addresses(person)
        browser_page.goto(address)
        browser_page.get_by_text("waiting for servers").wait_for()
        bare = browser_page.url
        for url in (bare, f"{bare}waiting", f"{bare}?token=wrong", f"{bare}waiting?token="):
            refused = patient_http.get(url)
            assert refused.status_code == 403 and "waiting for" not in refused.text
        view.send_signal(signal.SIGINT)
        view.communicate(timeout=PATIENCE)
        browser_page.get_by_text("volsplat has ended; its terminal tells why").wait_for()
    finally:
        view.kill()
        view.communicate()


def test_a_volume_that_is_there_at_once_is_opened_once(person: Person, browser_page: Page) -> None:
    view = person.starts("view", "head.nrrd", "--workers", "1")
    try:
        (address,) = opened_addresses(person)
        assert view.stderr is not None
        said = ""
        while "token=" not in said:  # the page is served
            said += view.stderr.readline()
        browser_page.goto(address)
        browser_page.get_by_text("head.nrrd").first.wait_for()
        view.send_signal(signal.SIGINT)
        view.communicate(timeout=PATIENCE)
        assert opened_addresses(person) == [address]
    finally:
        view.kill()
        view.communicate()
    assert not person.servers()
