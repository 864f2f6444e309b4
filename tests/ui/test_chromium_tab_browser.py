"""The tab of `volsplat bench page`."""

import os
from pathlib import Path

import psutil
import pytest

from support.pages.browser import chromium_executable
from volsplat.bench.chromium_tab import BROWSERS, ChromiumTab, RefusedByChromium, chromium_tab
from volsplat.protocol.text.errors import BadInput, VolsplatError

PAGE = "data:text/html,<body onmousemove='window.seen = [event.clientX, event.clientY, event.buttons]'>"


@pytest.fixture(autouse=True)
def _there_is_chromium() -> None:
    chromium_executable()


def test_a_page_takes_in_moves_with_and_without_waiting_and_its_window_is_as_large_as_is_said() -> None:
    with chromium_tab() as tab:
        tab.open(PAGE)
        tab.wait_for("() => document.readyState === 'complete'")
        tab.point("mouseMoved", 10, 20, button="none")
        tab.wait_for("(x, y) => window.seen?.join() === [x, y, 0].join()", 10, 20)
        tab.point("mousePressed", 10, 20)
        tab.move_on(30, 40)
        tab.wait_for("(x, y) => window.seen.join() === [x, y, 1].join()", 30, 40)
        tab.set_window(700, 300)
        assert tab.evaluate("() => [innerWidth, innerHeight, devicePixelRatio]") == [700, 300, 1]


def test_what_a_page_calls_back_is_heard_on_each_page() -> None:
    heard: list[str] = []
    with chromium_tab() as tab:
        tab.before_scripts("tellUs(location.hash)", "tellUs", heard.append)
        for end in ("#one", "#two"):
            tab.open(f"{PAGE}<p>{end[1:]}</p>{end}")
            tab.wait_for("(end) => location.hash === end", end)
    assert heard[-2:] == ["#one", "#two"]


def test_what_fails_on_the_page_or_in_chromium_is_told() -> None:
    with chromium_tab() as tab:
        with pytest.raises(VolsplatError, match="the page: Error: no such thing"):
            tab.evaluate("() => { throw new Error('no such thing'); }")
        with pytest.raises(VolsplatError, match=r"does not open nowhere://: net::ERR_"):
            tab.open("nowhere://")
        with pytest.raises(RefusedByChromium, match=r"refuses Emulation\.setDeviceMetricsOverride: "):
            tab.set_window(-1, -1)


def test_a_chromium_that_is_killed_is_gone_at_once_and_leaves_no_process() -> None:
    this = psutil.Process()
    before = set(this.children(recursive=True))

    def killed(tab: ChromiumTab) -> None:
        for process in set(this.children(recursive=True)) - before:
            process.kill()
        tab.wait_for("() => false")

    with pytest.raises(VolsplatError, match="Chromium is gone"), chromium_tab() as tab:
        killed(tab)
    assert set(this.children(recursive=True)) <= before


def test_why_chromium_does_not_start_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub = tmp_path / BROWSERS[0]
    stub.write_text("#!/bin/sh\necho 'this is a stub: install the snap' >&2\nexit 10\n")
    stub.chmod(0o700)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(VolsplatError, match="Chromium is gone: this is a stub: install the snap"), chromium_tab():
        pass
    stub.write_text("no program\n")
    with pytest.raises(BadInput, match="chromium does not start: Exec format error"), chromium_tab():
        pass
