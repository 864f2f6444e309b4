"""The person's browser, opened once: early if the volume takes a while, else when the page is there."""

from __future__ import annotations

import threading
import webbrowser
from types import TracebackType

import click

from volsplat.client.caller.interrupts import at_abrupt_end
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.redirect_file import RedirectFile
from volsplat.client.ui.doors.waiting_page import WaitingPage

OPEN_AFTER_SECONDS = 1.0


class BrowserTab:
    """Shows a waiting page from when it is entered until `make_room`."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self._address = address
        self._redirect: RedirectFile | None = None
        self._waiting = WaitingPage(address, name)
        self._timer = threading.Timer(OPEN_AFTER_SECONDS, self.open)
        self._timer.daemon = True
        self._lock = threading.Lock()  # guards what follows
        self._opened = False  # or never to be

    def say(self, line: str) -> None:
        """Tell what is being done while the volume is not there, from any thread."""
        self._waiting.line = line

    def make_room(self) -> None:
        """Leave the address to the page itself."""
        self._waiting.close()

    def open(self) -> None:
        """Open it, if it is not open yet."""
        with self._lock:
            if self._opened:
                return
            self._opened = True
            try:
                redirect = self._redirect = RedirectFile(self._address.url_for_once(self._remove_redirect))
            except OSError as error:  # the disk is full, say
                click.echo(f"no browser is opened ({error.strerror or error}); open {self._address.url}", err=True)
                return
        webbrowser.open(redirect.address)

    def _remove_redirect(self) -> None:
        if self._redirect is not None:
            self._redirect.remove()

    def __enter__(self) -> BrowserTab:
        at_abrupt_end(self._remove_redirect)
        self._waiting.start()
        self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        self._waiting.close()
        with self._lock:
            self._opened = True
        self._remove_redirect()
