"""A slow line from the server to a page."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page, WebSocketRoute


PATIENCE = 20_000  # milliseconds


class HeldAnswers:
    """What the server sends to a page, which can be kept from it for a while. To be made before the page is loaded."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._holding = False
        self._held: list[tuple[WebSocketRoute, str | bytes]] = []
        page.route_web_socket(lambda _: True, self._connect)

    @property
    def waiting(self) -> int:
        return len(self._held)

    def hold(self) -> None:
        self._holding = True

    def wait(self) -> None:
        """Until an answer is held."""
        for _ in range(PATIENCE // 20):
            if self._held:
                return
            self._page.wait_for_timeout(20)
        raise AssertionError("the server did not answer")

    def let_pass(self, count: int) -> None:
        """Hand over the first answers that wait."""
        for socket, message in self._held[:count]:
            socket.send(message)
        del self._held[:count]
        self._page.evaluate("() => new Promise(requestAnimationFrame)")  # so that the page has shown them

    def _connect(self, socket: WebSocketRoute) -> None:
        def answered(message: str | bytes) -> None:
            if self._holding:
                self._held.append((socket, message))
            else:
                socket.send(message)

        socket.connect_to_server().on_message(answered)
