"""The button that starts again what has ended."""

from __future__ import annotations

import asyncio

from nicegui import context, ui

from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Viewing


class StartAgain:
    """In one tab: over the picture, for as long as nothing can be drawn."""

    def __init__(self, viewing: Viewing, restart: Restart) -> None:
        self._restart = restart
        with ui.element("div").classes("vs-again") as self._place:
            self._button = ui.button("start it again", icon="restart_alt", on_click=self._start)
        self._show()
        context.client.on_delete(viewing.troubles.subscribe(lambda _: self._show()))

    async def _start(self) -> None:
        # What comes of it is told to all tabs; this one may be closed by then.
        await asyncio.to_thread(self._restart.start)

    def _show(self) -> None:
        self._place.set_visibility(self._restart.wanted or self._restart.starting)
        self._button.set_enabled(not self._restart.starting)
