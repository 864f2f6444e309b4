"""`--grace` in a real browser, by a clock that goes on only when it is told to: no machine is too slow for it."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING

from support.pages.browser import browser, browser_page
from support.patience import PATIENCE
from volsplat.bench.page_drag import REFINED
from volsplat.client.ui.application import LOADING_SECONDS

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

__all__ = ["browser", "browser_page"]

GRACE = 100.0
LOADING = GRACE + LOADING_SECONDS / 2  # a browser that has the page, and not yet its scripts, takes so long
CLOCK = """
import sys, threading, time
from volsplat.client.ui import application

class Clock:
    now, looks = 0.0, 0

    def monotonic(self):
        self.looks += 1
        return self.now

clock = application.time = Clock()
application.CHECK_SECONDS = 0.01

def obey():
    clock.now += float(sys.stdin.readline())
    print("it is later", flush=True)
    looks = clock.looks
    while clock.looks < looks + 2:
        time.sleep(0.01)
    print("it was looked whether a page is open", flush=True)
    seconds = float(sys.stdin.readline())
    while True:  # the page that goes away may be heard of later
        clock.now += seconds
        time.sleep(0.01)

threading.Thread(target=obey, daemon=True).start()
"""
VIEW = f"""{CLOCK}
from volsplat.client import Session
from volsplat.client.script.page_window import show_page
with Session(sys.argv[1], workers=1) as session:
    show_page(session, session.default_scene(), 0, False, float(sys.argv[2]))
"""
ASK = f"""{CLOCK}
from volsplat.client.command.cli import main
application.RECONNECT_SECONDS = 1e6  # a tab that is gone for so long is forgotten
sys.argv[1:] = ["view", "--no-browser", "--workers", "1", "--root", sys.argv[1], "--grace", sys.argv[2]]
main()
"""


@contextmanager
def viewed_by_a_script(script: str, path: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", script, str(path), str(GRACE)]
    said = subprocess.STDOUT
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, text=True) as process:
        watchdog = threading.Timer(2 * PATIENCE, process.kill)
        watchdog.start()
        try:
            yield process
        finally:
            watchdog.cancel()
            process.kill()


def told(lines: IO[str] | None, pattern: str) -> str:
    assert lines is not None
    found = next(filter(None, (re.search(pattern, line) for line in lines)), None)
    assert found is not None, "it has ended"
    return found[0]


def goes_on(process: subprocess.Popen[str], seconds: float) -> None:
    assert process.stdin is not None
    print(seconds, file=process.stdin, flush=True)


def test_it_does_not_end_between_a_page_s_first_answer_and_its_scripts(volume: Path, browser_page: Page) -> None:
    held: list[Route] = []
    browser_page.route(re.compile(r"\.m?js"), lambda route: held.append(route))
    with viewed_by_a_script(VIEW, volume) as process:
        browser_page.goto(told(process.stdout, r"http://\S+token=\S+"), wait_until="commit")
        goes_on(process, LOADING)
        told(process.stdout, "it was looked")
        browser_page.unroute_all()
        for route in held:
            route.continue_()
        browser_page.wait_for_function(REFINED)
        browser_page.goto("about:blank")
        goes_on(process, GRACE)
        assert process.wait(PATIENCE) == 0


def test_a_page_without_a_volume_is_open_until_its_tab_is_closed_and_no_longer(
    volume: Path, browser_page: Page
) -> None:
    with viewed_by_a_script(ASK, volume.parent) as process:
        browser_page.goto(told(process.stdout, r"http://\S+token=\S+"))
        browser_page.get_by_role("button", name="head.nrrd").wait_for()
        goes_on(process, 10 * GRACE)
        told(process.stdout, "it is later")
        browser_page.goto("about:blank")
        told(process.stdout, "it was looked")
        goes_on(process, GRACE)
        assert process.wait(PATIENCE) == 0
