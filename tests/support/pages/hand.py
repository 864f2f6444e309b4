"""A page that is used as by a hand, which does not wait until a move has been taken in.

By Playwright's asynchronous interface, in a browser and a thread of its own: that of other tests has a running loop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from support.pages.browser import ARGUMENTS, WINDOW, chromium_executable
from volsplat.bench.page_drag import PAGE_WAIT, REFINED

if TYPE_CHECKING:
    from playwright.async_api import Page

Result = TypeVar("Result")


def by_a_hand(address: str, use: Callable[[Page], Awaitable[Result]]) -> Result:
    """What comes of using the page at the address, once its picture is finished."""
    executable = chromium_executable()

    async def used() -> Result:
        from playwright.async_api import async_playwright

        async with async_playwright() as playwright:
            browser = await playwright.chromium.launch(executable_path=executable, args=ARGUMENTS)
            tab = await browser.new_page(viewport=WINDOW)
            await tab.goto(address)
            await tab.wait_for_function(REFINED, timeout=PAGE_WAIT)
            result = await use(tab)
            await browser.close()
        return result

    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(used())).result()
