"""Files that a person drops on the page, for which a browser would leave it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

from nicegui import ui
from nicegui.element import Element
from nicegui.events import GenericEventArguments

from volsplat.client.ui.controls.scene_upload import SceneUpload, tell_trouble
from volsplat.client.ui.doors.static_files import MODULES, STATIC
from volsplat.client.ui.opening.opening import Dropped
from volsplat.client.ui.viewing.saving import SCENE_FILE, SCENE_FILES
from volsplat.protocol.text.printable import printable

OFTEN_VOLUMES = (".tif", ".tiff")  # as what they are taken, though they may hold a scene


class DroppedFiles(Element, component="dropped_files_component.js", esm=MODULES):
    """Takes what is dropped anywhere: a scene goes to `scenes`, the name of anything else to `offer`.

    No file but a scene is read: volumes are opened by servers, from where they see them. Without `scenes`, no volume is
    shown whose scene it could be.
    """

    def __init__(self, scenes: SceneUpload | None, offer: Callable[[Dropped], Awaitable[None]]) -> None:
        super().__init__()
        ui.add_css(STATIC / "opening" / "dropping.css")
        self._offer = offer
        self._props["scenes"] = [suffix for suffix in SCENE_FILES if suffix not in OFTEN_VOLUMES]
        self._props["upload"] = None if scenes is None else scenes.id
        self.on("dropped", self._dropped)

    async def _dropped(self, event: GenericEventArguments) -> None:
        name, size, is_folder, count = event.args
        if count > 1:
            tell_trouble(f"{count} files were dropped: drop one, or the folder that they make a volume in")
        elif Path(name).suffix.lower() == SCENE_FILE:
            tell_trouble(f"{printable(name)}: a scene needs a volume; open that first, then drop the scene again")
        else:
            await self._offer(Dropped(str(name), int(size), bool(is_folder)))


async def refuse(dropped: Dropped) -> None:
    """Of a page that keeps to its volume."""
    name = printable(dropped.name)
    tell_trouble(f"{name}: this page stays with its volume; run: volsplat view {name}")
