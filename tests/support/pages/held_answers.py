"""A slow line from the server to a page."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from support.pages.tables_tab import until

if TYPE_CHECKING:
    from playwright.sync_api import Page, WebSocketRoute


class HeldAnswers:
    """What the server sends to a page, which can be kept from it for a while. To be made before the page is loaded."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._holding = False
        self._held: list[tuple[WebSocketRoute, str | bytes]] = []
        page.route_web_socket(lambda _: True, self._connect)

    def press_ahead(self, key: str, heard: Callable[[], object]) -> None:
        """Press a key four times; what answers the first press, which `heard` waits for, comes before the last."""
        self.keep()
        self._page.keyboard.press(key)
        heard()
        late = self.kept_until("")
        self._page.keyboard.press(key)
        self._page.keyboard.press(key)
        self.let_pass(late)
        self._page.keyboard.press(key)
        self.let_all_pass()

    def keep(self) -> None:
        """From now on nothing comes."""
        self._holding = True

    def kept_until(self, text: str) -> int:
        """Waits until something with this text is kept, and tells how many messages then are."""
        until(self._page, lambda: any(text in str(message) for _, message in self._held))
        return len(self._held)

    def let_pass(self, count: int) -> None:
        """Hand over the first messages that are kept."""
        for socket, message in self._held[:count]:
            socket.send(message)
        del self._held[:count]
        self._page.evaluate("() => new Promise(requestAnimationFrame)")  # so that the page has shown them

    def let_all_pass(self) -> None:
        """Hand over all that is kept, and keep nothing more."""
        self._holding = False
        self.let_pass(len(self._held))

    def _connect(self, socket: WebSocketRoute) -> None:
        def answered(message: str | bytes) -> None:
            if self._holding:
                self._held.append((socket, message))
            else:
                socket.send(message)

        socket.connect_to_server().on_message(answered)
