"""The tables' panel for all modules here: one program, and one tab that is kept while it looks as just loaded."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from support.pages.browser import browser, browser_page, kept_as_loaded
from support.pages.tables_tab import Tab, begin_anew, tables_program

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

    from support.pages.browser import Chromium

__all__ = ["browser", "browser_page"]


@pytest.fixture(scope="session")
def url() -> Iterator[str]:
    with tables_program() as url:
        yield url


@pytest.fixture
def tab(chromium: Chromium, browser: Browser, url: str, request: pytest.FixtureRequest) -> Iterator[Tab]:
    """A tab on the panel of a session that just begins."""
    context, test = chromium.lasting_context(browser, url), request.node.nodeid
    with kept_as_loaded(context, url, test, lambda page: Tab(page, url).load("/anew"), begin_anew) as page:
        yield Tab(page, url)


@pytest.fixture
def fresh_tab(browser_page: Page, url: str) -> Tab:
    """The same, just loaded, for tests that change the page itself."""
    return Tab(browser_page, url).load("/anew")
