"""What a person chooses a volume from: recent ones, phantoms, and what lies in folders, as the servers see them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import NamedTuple

from nicegui import context, ui
from nicegui.events import GenericEventArguments

from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.opening.folder_list import FOLDER, PHANTOM, UP, VOLUME, FolderList, Row
from volsplat.client.ui.opening.opening import Dropped, Keep, News, Opening, Place
from volsplat.client.ui.opening.opening_progress import OpeningProgress
from volsplat.client.ui.opening.phantom_files import PHANTOMS
from volsplat.protocol.messages.folder_messages import FolderEntry, FolderListed
from volsplat.protocol.text.byte_sizes import size_on_disk
from volsplat.protocol.text.errors import VolsplatError
from volsplat.protocol.text.printable import printable

BROWSERS_HIDE = "A browser does not tell where a dropped file lies"
OF_PHANTOMS = "phantoms, which volsplat makes itself"


class Choice(NamedTuple):
    """A row of the list, and what follows if it is chosen."""

    row: Row
    chosen: Callable[[], Awaitable[None]]


class VolumeChooser:
    """One tab's, within the element that is open. What is being opened is seen in all tabs, and ended in any.

    `may_keep_tables`: of a volume that is shown.
    """

    def __init__(self, opening: Opening, may_keep_tables: bool) -> None:
        self._opening = opening
        self._folder = opening.first_folder
        self._choices: list[Choice] = []
        self._recent: list[Place] = []
        self._newest = 0  # of the questions what lies in a folder
        self._entered = ""  # what was typed and entered last
        ui.add_css(STATIC / "opening" / "opening.css")
        self._recent_title = ui.label("recent").classes("vs-muted")
        self._recent_list = FolderList("recent volumes", self._choose_recent)
        with ui.element("div").classes("vs-open-where"):
            self._where = ui.label("").classes("vs-entry-name")
            self._words = ui.input("part of a name, or a path", on_change=self._find).props("dense debounce=250")
            self._words.on("keydown.enter", self._open_named, js_handler="(event) => emit(event.target.value)")
        self._list = FolderList("volumes and folders", self._choose)
        self._left_out = ui.label("").classes("vs-muted")
        self._keep = ui.switch("keep the tables").props("dense")
        self._keep.set_visibility(may_keep_tables)
        self._trouble = ui.label("").classes("vs-bad").props("role=alert")
        OpeningProgress(opening)
        self._tell(opening.now)
        context.client.on_delete(opening.news.subscribe(self._tell))

    def show_recent(self, recent: Sequence[Place]) -> None:
        self._trouble.text = ""
        self._recent = list(recent)
        self._recent_list.show([Row(str(place), "", "", VOLUME) for place in self._recent])
        self._recent_list.set_visibility(bool(self._recent))
        self._recent_title.set_visibility(bool(self._recent))

    async def _find(self) -> None:
        """What was typed has changed; what was said of something else counts no more."""
        if (self._words.value or "").strip() != self._entered:
            self._trouble.text = ""
        await self.look()

    async def look(self) -> None:
        """Show what lies in the folder by now; only the newest question counts."""
        self._newest += 1
        number, folder = self._newest, self._folder
        self._where.text = f"{self._opening.root_name}/{folder}" if folder else self._opening.root_name
        if self._opening.waits_for_servers:
            self._left_out.text = "waiting for a map/shade server to join"
        try:
            listed = await asyncio.to_thread(self._opening.listed, folder, self._words.value or "")
        except VolsplatError as error:
            if number == self._newest:
                self._trouble.text = str(error)
            return
        if number == self._newest:
            self._show(listed)

    async def offer(self, dropped: Dropped) -> None:
        """What may be a file that a person dropped on the page; where there is none, what lies in the folder."""
        await self.look()
        self._newest += 1
        number, self._trouble.text = self._newest, ""
        try:
            alike = await asyncio.to_thread(self._opening.alike, dropped)
        except VolsplatError as error:
            self._trouble.text = str(error)
            return
        if number != self._newest:
            return
        if not alike:
            self._trouble.text = self._nothing_alike(printable(dropped.name))
            return
        self._where.text, self._left_out.text = f"is it this {printable(dropped.name)}?", BROWSERS_HIDE
        back = Choice(Row("..", "back to the folder", "", UP), partial(self._go, self._folder))
        self._offer([back, *(self._choice(place, entry, str(place)) for place, entry in alike)])

    def _nothing_alike(self, name: str) -> str:
        folders = ", ".join(folder or self._opening.root_name for folder in self._opening.folders_known)
        return f"no {name} in {folders}. {BROWSERS_HIDE}: go to its folder below, or run there: volsplat view {name}"

    def _show(self, listed: FolderListed) -> None:
        entries = ((Place(self._folder, entry.name, entry.part), entry) for entry in listed.entries)
        self._offer([*self._ways(), *(self._choice(place, entry, entry.name) for place, entry in entries)])
        told = "" if listed.entries else "no volume and no folder here"
        if listed.left_out:
            told = f"{listed.left_out} more are there; a part of a name finds them"
        self._left_out.text = told

    def _ways(self) -> list[Choice]:
        """Out of this folder."""
        if self._folder:
            return [Choice(Row("..", "the folder above", "", UP), partial(self._go, self._folder.rpartition("/")[0]))]
        if self._opening.phantoms and not self._words.value:
            return [Choice(Row("phantoms", "made by volsplat, to try it", "", PHANTOM), self._show_phantoms)]
        return []

    def _choice(self, place: Place, entry: FolderEntry, name: str) -> Choice:
        row = Row(
            name or entry.kind,
            entry.kind if entry.name else "",
            size_on_disk(entry.bytes) if entry.bytes else "",
            VOLUME if entry.is_volume else FOLDER,
        )
        if entry.is_folder:
            return Choice(row, partial(self._open_part, place) if entry.is_volume else partial(self._go, str(place)))
        return Choice(row, partial(self._open, place))

    async def _open_part(self, place: Place) -> None:
        """Open it, or show which of its parts can be opened."""
        self._newest += 1
        number, self._trouble.text = self._newest, ""
        try:
            listed = await asyncio.to_thread(self._opening.parts, place)
        except VolsplatError as error:
            self._trouble.text = str(error)
            return
        if number != self._newest:  # something else is looked at by now
            return
        if len(listed.entries) < 2:
            await self._open(place)
            return
        self._where.text = f"parts of {place}"
        self._left_out.text = f"{listed.left_out} more are there; name one after a #" if listed.left_out else ""
        back = Choice(Row("..", "back to the folder", "", UP), partial(self._go, place.folder))
        parts = [
            Choice(Row(one.part, one.kind, "", VOLUME), partial(self._open_part, place._replace(part=one.part)))
            for one in listed.entries
        ]
        self._offer([back, *parts])

    def _offer(self, choices: list[Choice]) -> None:
        self._choices = choices
        self._list.show([choice.row for choice in choices])

    async def _show_phantoms(self) -> None:
        """In the place of what lies in the folder."""
        self._newest += 1
        self._where.text, self._left_out.text = OF_PHANTOMS, ""
        back = Choice(Row("..", "back to the folder", "", UP), partial(self._go, ""))
        phantoms = [
            Choice(Row(name, PHANTOMS[name], "", PHANTOM), partial(self._open, Place("", name, is_phantom=True)))
            for name in self._opening.phantoms
        ]
        self._offer([back, *phantoms])

    async def _choose(self, number: int) -> None:
        if number < len(self._choices):
            await self._choices[number].chosen()

    async def _choose_recent(self, number: int) -> None:
        if number < len(self._recent):
            await self._open(self._recent[number])

    async def _go(self, folder: str) -> None:
        self._folder, self._trouble.text = folder, ""
        self._words.set_value("")
        await self.look()

    async def _open_named(self, event: GenericEventArguments) -> None:
        """What was typed is the way to a volume or a folder, of whose last name a part may do."""
        if not (typed := str(event.args).strip()):
            return
        self._entered, self._trouble.text = typed, ""
        try:
            place = await asyncio.to_thread(self._opening.place_named, self._folder, typed)
        except VolsplatError as error:
            self._trouble.text = str(error)
            return
        await (self._go(place) if isinstance(place, str) else self._open_part(place))

    async def _open(self, place: Place) -> None:
        """Every tab is loaded anew once it is there."""
        self._trouble.text = ""
        try:
            await self._opening.open(place, Keep.TABLES if self._keep.value else Keep.NOTHING)
        except VolsplatError as error:
            self._trouble.text = str(error)

    def _tell(self, news: News) -> None:
        for rows in (self._list, self._recent_list):
            rows.set_busy(news.opening != "")
