"""A list of what can be opened, as the page shows it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.doors.static_files import MODULES

FOLDER, VOLUME, UP, PHANTOM = "folder", "view_in_ar", "drive_folder_upload", "auto_awesome"


@dataclass(frozen=True)
class Row:
    """A button of the list: what it says, and its icon by Material's name."""

    name: str
    kind: str
    size: str
    icon: str


class FolderList(Element, component="folder_list_component.js", esm=MODULES):
    """`on_chosen` is told the number of the row that a person chooses."""

    def __init__(self, label: str, on_chosen: Callable[[int], object]) -> None:
        super().__init__()
        self._props["label"] = label
        self._props["entries"] = []
        self._props["busy"] = False

        def chosen(event: GenericEventArguments) -> object:
            return on_chosen(int(event.args))

        self.on("chosen", chosen)

    def show(self, rows: Sequence[Row]) -> None:
        self._props["entries"] = [asdict(row) for row in rows]
        self.update()

    def set_busy(self, busy: bool) -> None:
        """Whether nothing can be chosen now."""
        if busy != self._props["busy"]:
            self._props["busy"] = busy
            self.update()
