"""What is being opened, with a button that gives it up: seen while something is, and then in all tabs."""

from __future__ import annotations

from nicegui import context, ui

from volsplat.client.ui.opening.opening import News, Opening


class OpeningProgress:
    """One tab's, in one place of it."""

    def __init__(self, opening: Opening) -> None:
        with ui.element("div").classes("vs-opening") as self._whole:
            self._line = ui.label("").classes("vs-muted").props("role=status")
            ui.linear_progress(show_value=False).props("indeterminate rounded aria-label='being opened'")
            ui.button("cancel", on_click=opening.cancel).props("flat no-caps")
        self._tell(opening.now)
        context.client.on_delete(opening.news.subscribe(self._tell))

    def _tell(self, news: News) -> None:
        self._line.text = f"opening {news.opening}: {news.line}" if news.opening else ""
        self._whole.set_visibility(bool(news.opening))
