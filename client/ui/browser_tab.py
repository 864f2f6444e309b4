"""The person's browser, opened once: early where the volume takes a while, else when the page is there."""

from __future__ import annotations

import threading
import webbrowser
from types import TracebackType

from volsplat.client.ui.page_address import PageAddress
from volsplat.client.ui.waiting_page import WaitingPage

OPEN_AFTER_SECONDS = 1.0


class BrowserTab:
    """Shows a waiting page from when it is entered until `make_room`."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self._url = address.url
        self._waiting = WaitingPage(address, name)
        self._timer = threading.Timer(OPEN_AFTER_SECONDS, self.open)
        self._timer.daemon = True
        self._opening = threading.Lock()  # taken for good by whoever opens it

    def say(self, line: str) -> None:
        """Tell what is being done while the volume is not there, from any thread."""
        self._waiting.line = line

    def make_room(self) -> None:
        """Leave the address to the page itself."""
        self._waiting.close()

    def open(self) -> None:
        """Open it, if it is not open yet."""
        if self._opening.acquire(blocking=False):
            webbrowser.open(self._url)

    def __enter__(self) -> BrowserTab:
        self._waiting.start()
        self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        self._waiting.close()
