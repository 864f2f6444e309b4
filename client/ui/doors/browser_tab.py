"""The person's browser, opened at once: it starts, and shows what is being done, while the volume is read."""

from __future__ import annotations

import threading
import webbrowser
from types import TracebackType

import click

from volsplat.client.caller.interrupts import at_abrupt_end
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.redirect_file import RedirectFile
from volsplat.client.ui.doors.waiting_page import WaitingPage


class BrowserTab:
    """Shows a waiting page from when it is entered until `make_room`."""

    def __init__(self, address: PageAddress, name: str) -> None:
        self._address = address
        self._redirect: RedirectFile | None = None
        self._waiting = WaitingPage(address, name)

    def say(self, line: str) -> None:
        """Tell what is being done while the volume is not there, from any thread."""
        self._waiting.say(line)

    def show(self, picture: bytes) -> None:
        """Show the first picture, as JPEG, from any thread."""
        self._waiting.show(picture)

    def make_room(self) -> None:
        """Leave the address to the page itself."""
        self._waiting.close()

    def open(self) -> None:
        try:
            redirect = self._redirect = RedirectFile(self._address.url_for_once(self._remove_redirect))
        except OSError as error:  # the disk is full, say
            click.echo(f"no browser is opened ({error.strerror or error}); open {self._address.url}", err=True)
            return
        # Some browsers keep who opens them waiting.
        threading.Thread(target=webbrowser.open, args=(redirect.address,), name="open the browser", daemon=True).start()

    def _remove_redirect(self) -> None:
        if self._redirect is not None:
            self._redirect.remove()

    def __enter__(self) -> BrowserTab:
        at_abrupt_end(self._remove_redirect)
        self._waiting.start()
        try:
            self.open()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def _end(self) -> None:
        self._waiting.close()
        self._remove_redirect()
