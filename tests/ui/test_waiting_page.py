"""What the browser shows while the volume is not there yet, and that the page itself follows."""

from __future__ import annotations

import io
import shlex
import signal
import socket
import sys
from pathlib import Path

import pytest
from PIL import Image as PillowImage
from playwright.sync_api import Page

from support.pages import patient_http
from support.pages.browser import browser, browser_page
from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.programs import Person
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.waiting_page import WaitingPage

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


def test_the_first_picture_is_shown_in_its_place_and_to_who_asked_before_the_end(browser_page: Page) -> None:
    out = io.BytesIO()
    PillowImage.new("RGB", (64, 64), (200, 40, 40)).save(out, "JPEG")
    with socket.create_server(("127.0.0.1", 0)) as bound:
        address = PageAddress(bound)
        waiting = WaitingPage(address, "head")
        waiting.start()
        browser_page.goto(address.url)
        browser_page.get_by_text("starting").wait_for()
        image = browser_page.locator(".vs-early img")
        assert not image.is_visible()
        waiting.say("reading")
        browser_page.get_by_text("reading").wait_for()
        waiting.close()
        waiting.show(out.getvalue())
        image.wait_for()
        box, place = image.bounding_box(), browser_page.locator(".vs-view").bounding_box()
        assert box is not None and place is not None
        assert all(abs(box[side] - place[side]) <= 8 for side in ("x", "y", "width", "height"))
        shown = PillowImage.open(io.BytesIO(image.screenshot())).convert("RGB")
        red, green, blue = shown.getpixel((shown.width // 2, shown.height // 2))  # type: ignore[misc]
        assert red > 150 and green < 90 and blue < 90


def test_nothing_is_told_without_the_token_and_ctrl_c_ends_it(person: Person, browser_page: Page) -> None:
    words, _ = listening(person)
    view = person.starts(*words)
    try:
        (address,) = opened_addresses(person)
        browser_page.goto(address)
        browser_page.get_by_text("waiting for servers").wait_for()
        bare = browser_page.url
        for url in (bare, f"{bare}waiting", f"{bare}early", f"{bare}?token=wrong", f"{bare}waiting?token="):
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
