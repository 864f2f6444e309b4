"""A scene that a person has in a file, taken from the browser: a scene file, or an image that holds its scene."""

from __future__ import annotations

import asyncio
from weakref import ref

from nicegui import events, ui

from volsplat.client.ui.viewing.saving import LARGEST_UPLOAD, SCENE_FILES, scene_in_file
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.text.byte_sizes import size_on_disk
from volsplat.protocol.text.errors import VolsplatError


class SceneUpload(ui.upload):
    """Never seen: a menu opens its file picker, or it is handed what is dropped on the page."""

    def __init__(self, viewing: Viewing) -> None:
        super().__init__(on_upload=self._show, on_rejected=_refuse, auto_upload=True, max_file_size=LARGEST_UPLOAD)
        self._viewing = ref(viewing)  # FastAPI keeps the routes of uploads, and so this element, when its page is gone
        self.props(f"accept={','.join(SCENE_FILES)}").style("display: none")

    def pick(self) -> None:
        self.run_method("pickFiles")

    async def _show(self, event: events.UploadEventArguments) -> None:
        viewing = self._viewing()
        if viewing is None:
            return
        self.reset()
        data, name = await event.file.read(), event.file.name
        try:
            viewing.show_scene(await asyncio.to_thread(scene_in_file, data, viewing.model.scene, name))
        except VolsplatError as error:
            tell_trouble(str(error))


def tell_trouble(line: str) -> None:
    """Until the person has read it."""
    ui.notify(line, type="negative", timeout=0, close_button=True)


def _refuse() -> None:
    largest = size_on_disk(LARGEST_UPLOAD)
    tell_trouble(
        f"this holds no scene: take what was saved here, one of {', '.join(SCENE_FILES)}, of {largest} at most"
    )
