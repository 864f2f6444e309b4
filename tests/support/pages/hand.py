"""A page that is used as by a hand, which does not wait until a move has been taken in: in a Chromium of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from support.pages.browser import chromium_executable
from volsplat.bench.chromium_tab import ChromiumTab, chromium_tab
from volsplat.bench.page_drag import REFINED


@contextmanager
def under_a_hand(address: str) -> Iterator[ChromiumTab]:
    """The page at the address, once its picture is finished. Without Chromium the test is skipped."""
    chromium_executable()
    with chromium_tab() as tab:
        tab.open(address)
        tab.wait_for(REFINED)
        yield tab
