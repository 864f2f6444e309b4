"""How long `view` waits for a page before it ends by itself (--grace)."""

import asyncio

import pytest

from volsplat.client.ui import application
from volsplat.client.ui.application import LOADING_SECONDS, OpenPages


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(application, "time", clock)
    return clock


def test_a_page_that_a_browser_still_loads_counts_as_open(clock: Clock) -> None:
    pages = OpenPages()
    clock.now += 1.0
    assert pages.none_for(1.0)
    pages.coming()
    clock.now += LOADING_SECONDS
    assert not pages.none_for(1.0)
    clock.now += 1.0
    assert pages.none_for(1.0), "a browser that never came is waited for no more"


def test_once_its_viewport_has_been_there_it_counts_as_long_as_that(clock: Clock) -> None:
    async def visited(pages: OpenPages) -> None:
        async with pages.one_more():
            clock.now += 1000.0
            assert not pages.none_for(0.0)

    pages = OpenPages()
    pages.coming()
    asyncio.run(visited(pages))
    clock.now += 1.0
    assert pages.none_for(1.0)
