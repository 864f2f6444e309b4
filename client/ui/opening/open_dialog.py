"""The page's dialog that opens another volume."""

from __future__ import annotations

from nicegui import ui

from volsplat.client.ui.opening.opening import Dropped, Opening
from volsplat.client.ui.opening.volume_chooser import VolumeChooser


class OpenDialog:
    """One tab's dialog, and the button that shows it."""

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        button = ui.button(icon="folder_open", color=None, on_click=self.open).props("flat dense round")
        button.classes("vs-icon-button vs-open-volume").props("aria-label='open another volume'")
        button.tooltip("open another volume (O)")
        with ui.dialog() as self._dialog, ui.card().classes("vs-dialog vs-open"):
            ui.label("Open a volume").classes("vs-name").props("role=heading aria-level=2")
            self._chooser = VolumeChooser(opening, may_keep_tables=True)
            ui.button("close", on_click=self._dialog.close).props("flat no-caps")

    async def open(self) -> None:
        """Show it, with what lies in the folder by now."""
        self._chooser.show_recent(self._opening.recent[1:])
        self._dialog.open()
        await self._chooser.look()

    async def offer(self, dropped: Dropped) -> None:
        """Show it, with what bears the name of a file that was dropped on the page."""
        self._chooser.show_recent([])
        self._dialog.open()
        await self._chooser.offer(dropped)
