"""The page's dialog that opens another volume: recent ones, and what lies in folders, as the servers see them."""

from __future__ import annotations

import asyncio

from nicegui import context, ui

from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.opening.folder_list import FOLDER, UP, VOLUME, FolderList, Row
from volsplat.client.ui.opening.opening import News, Opening, Place
from volsplat.protocol.messages.folder_messages import FolderEntry, FolderListed
from volsplat.protocol.text.byte_sizes import size_on_disk
from volsplat.protocol.text.errors import VolsplatError


class OpenDialog:
    """One tab's dialog, and the button that shows it. What is being opened is seen in all tabs, and ended in any."""

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        self._folder = opening.first_folder
        self._entries: list[FolderEntry] = []
        self._recent: list[Place] = []
        self._newest = 0  # of the questions what lies in a folder
        ui.add_css(STATIC / "opening" / "opening.css")
        button = ui.button(icon="folder_open", color=None, on_click=self.open).props("flat dense round")
        button.classes("vs-icon-button vs-open-volume").props("aria-label='open another volume'")
        button.tooltip("open another volume (O)")
        with ui.dialog() as self._dialog, ui.card().classes("vs-dialog vs-open"):
            ui.label("Open a volume").classes("vs-name").props("role=heading aria-level=2")
            self._recent_title = ui.label("recent").classes("vs-muted")
            self._recent_list = FolderList("recent volumes", self._choose_recent)
            with ui.element("div").classes("vs-open-where"):
                self._where = ui.label("").classes("vs-entry-name")
                self._words = ui.input("part of a name", on_change=self._list).props("dense debounce=250")
            self._list_of_folder = FolderList("volumes and folders", self._choose)
            self._left_out = ui.label("").classes("vs-muted")
            self._keep = ui.switch("keep the tables").props("dense")
            self._trouble = ui.label("").classes("vs-bad").props("role=alert")
            self._line = ui.label("").classes("vs-muted").props("role=status")
            self._bar = ui.linear_progress(show_value=False).props("indeterminate rounded")
            with ui.row().classes("justify-end w-full"):
                self._cancel = ui.button("cancel", on_click=opening.cancel).props("flat no-caps")
                ui.button("close", on_click=self._dialog.close).props("flat no-caps")
        self._tell(opening.now)
        context.client.on_delete(opening.news.subscribe(self._tell))

    async def open(self) -> None:
        """Show it, with what lies in the folder by now."""
        self._trouble.text = ""
        self._recent = self._opening.recent[1:]
        self._recent_list.show([Row(str(place), "", "", VOLUME) for place in self._recent])
        self._recent_list.set_visibility(bool(self._recent))
        self._recent_title.set_visibility(bool(self._recent))
        self._dialog.open()
        await self._list()

    async def _list(self) -> None:
        """Show what lies in the folder; only the newest question counts."""
        self._newest += 1
        number, folder = self._newest, self._folder
        self._where.text = f"{self._opening.root_name}/{folder}" if folder else self._opening.root_name
        try:
            listed = await asyncio.to_thread(self._opening.listed, folder, self._words.value or "")
        except VolsplatError as error:
            if number == self._newest:
                self._trouble.text = str(error)
            return
        if number == self._newest:
            self._show(listed)

    def _show(self, listed: FolderListed) -> None:
        self._entries = listed.entries
        up = [Row("..", "the folder above", "", UP)] if self._folder else []
        self._list_of_folder.show([*up, *map(_row, self._entries)])
        told = "" if self._entries else "no volume and no folder here"
        if listed.left_out:
            told = f"{listed.left_out} more are there; a part of a name finds them"
        self._left_out.text = told

    async def _choose(self, number: int) -> None:
        if self._folder:
            number -= 1
        if number < 0:
            await self._go(self._folder.rpartition("/")[0])
        elif number < len(self._entries):
            entry = self._entries[number]
            if entry.is_folder:
                await self._go(f"{self._folder}/{entry.name}" if self._folder else entry.name)
            else:
                await self._open(Place(self._folder, entry.name, entry.part))

    async def _choose_recent(self, number: int) -> None:
        if number < len(self._recent):
            await self._open(self._recent[number])

    async def _go(self, folder: str) -> None:
        self._folder, self._trouble.text = folder, ""
        self._words.set_value("")
        await self._list()

    async def _open(self, place: Place) -> None:
        """Every tab is loaded anew once it is there."""
        self._trouble.text = ""
        try:
            await self._opening.open(place, self._keep.value)
        except VolsplatError as error:
            self._trouble.text = str(error)

    def _tell(self, news: News) -> None:
        running = news.opening != ""
        self._line.text = f"opening {news.opening}: {news.line}" if running else ""
        for part in (self._line, self._bar, self._cancel):
            part.set_visibility(running)
        for rows in (self._list_of_folder, self._recent_list):
            rows.set_busy(running)


def _row(entry: FolderEntry) -> Row:
    name = entry.name or entry.kind
    return Row(
        name,
        entry.kind if entry.name else "",
        size_on_disk(entry.bytes) if entry.bytes else "",
        FOLDER if entry.is_folder else VOLUME,
    )
