"""A line between a page's panels and the process that loses what is on its way, and is cut."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from support.pages.tables_tab import until

if TYPE_CHECKING:
    from playwright.sync_api import Page, WebSocketRoute

_PANELS = re.compile("/_nicegui_ws/")


class LossyLine:
    """To be made before the page is loaded."""

    def __init__(self, page: Page) -> None:
        self.loses_events = self.loses_answers = False
        self._page = page
        self._lost: list[str] = []
        self._cut: list[WebSocketRoute] = []  # all sockets but the newest, whose last messages may be late
        self._newest: WebSocketRoute | None = None
        page.route_web_socket(_PANELS, self._connect)

    def cut_once_lost(self, text: str) -> None:
        """Wait until a message with this text is lost, then cut the line; the next one loses nothing."""
        until(self._page, lambda: any(text in message for message in self._lost))
        self.loses_events = self.loses_answers = False
        assert self._newest is not None
        self._cut.append(self._newest)
        self._newest.close()

    def _connect(self, socket: WebSocketRoute) -> None:
        self._newest = socket
        server = socket.connect_to_server()

        def told(message: str | bytes) -> None:
            if self.loses_events or socket in self._cut:
                self._lost.append(str(message))
            else:
                server.send(message)

        def answered(message: str | bytes) -> None:
            if self.loses_answers or socket in self._cut:
                self._lost.append(str(message))
            else:
                socket.send(message)

        socket.on_message(told)
        server.on_message(answered)
