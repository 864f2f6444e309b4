"""The page's menu for saving: the image, the scene, a link to it, and a movie."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from functools import cache, partial

from nicegui import context, ui

from volsplat.client.ui.controls.controls import menu_by_arrows
from volsplat.client.ui.controls.scene_upload import SceneUpload
from volsplat.client.ui.doors.handed_files import hand_bytes
from volsplat.client.ui.doors.saved_names import stem_of
from volsplat.client.ui.panels.figure_dialog import FigureDialog
from volsplat.client.ui.panels.movie_dialog import MovieDialog
from volsplat.client.ui.viewing.finished_picture import FinishedPicture
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.saving import ImageFormat, image_bytes, scene_bytes, scene_link
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.text.errors import VolsplatError

ANSWER_WITHIN = 30.0  # seconds: a browser may ask the person first

_NOT_COPIED = (
    "not copied: browsers allow it on HTTPS and localhost only; "
    "copy the link from here, or save the scene as TOML instead"
)

# Browsers let a page copy in a click alone, before the process has told of the link: they are given the promise of it.
_COPIES = """() => {
    const link = new Promise((told) => { window.tellLink = told; });
    const text = async () => new Blob([await link], { type: "text/plain" });
    const copied = async () => "ClipboardItem" in window
        ? navigator.clipboard.write([new ClipboardItem({ "text/plain": text() })])
        : navigator.clipboard.writeText(await link);
    window.linkCopied = copied().then(() => true, () => false);
    emit();
}"""


def save_panel(viewing: Viewing, scenes: SceneUpload) -> None:
    save = ui.button("save", icon="save_alt").props("flat dense no-caps aria-label=save")
    figure = _built_when_opened(partial(FigureDialog, viewing, file_stem(viewing), save))
    movie = _built_when_opened(partial(MovieDialog, viewing, file_stem(viewing), save))
    with save:
        with menu_by_arrows().props("auto-close"):
            ui.menu_item("image as PNG", partial(_save_image, viewing, "png"))
            ui.menu_item("image as EXR, with alpha", partial(_save_image, viewing, "exr"))
            ui.menu_item("figure…", figure)
            ui.separator()
            ui.menu_item("scene as TOML", partial(_save_scene, viewing))
            ui.menu_item("open a scene…", scenes.pick)
            copying = ui.menu_item("copy a link to this scene")
            copying.on("click", partial(_copy_link, viewing), js_handler=_COPIES)
            ui.separator()
            ui.menu_item("movie…", movie)


def _built_when_opened(build: Callable[[], FigureDialog | MovieDialog]) -> Callable[[], None]:
    """What opens a dialog. The page need not wait for what most never open."""
    place, built = ui.element("div").style("display: none"), cache(build)

    def open_it() -> None:
        with place:
            built().open()

    return open_it


async def _save_image(viewing: Viewing, kind: ImageFormat) -> None:
    """The image of the finest step, once it is there."""
    try:
        picture = await _finished(viewing)
        description = viewing.volume.description
        data = await asyncio.to_thread(image_bytes, picture.published.pixels, picture.state.scene, kind, description)
        await hand_bytes(data, f"{file_stem(viewing)}.{kind}")
    except VolsplatError as error:
        ui.notify(str(error), type="negative")


async def _finished(viewing: Viewing) -> Picture:
    """Told of if it takes a while; for as long as the tab is there. Raises VolsplatError if there will be none."""
    finished = FinishedPicture(viewing)
    if finished.is_known:
        return await finished.wait()
    context.client.on_delete(finished.cancel)
    waiting = ui.notification("waiting for the finished picture", spinner=True, timeout=None)
    try:
        return await finished.wait()
    finally:
        waiting.dismiss()


def file_stem(viewing: Viewing) -> str:
    """A file name from the volume's, without an ending."""
    return stem_of(viewing.volume.description.name)


def _save_scene(viewing: Viewing) -> None:
    ui.download(scene_bytes(viewing.model.scene), f"{file_stem(viewing)}.toml")


async def _copy_link(viewing: Viewing) -> None:
    """As the browser reaches the page, perhaps through a forwarded port, and without anything that opens it."""
    page = str(context.client.request.base_url)
    link = scene_link(page, viewing.model.scene, viewing.default_scene, viewing.volume.description.name)
    if await _is_copied(link):
        told = "copied: the link restores this scene in a browser that may see this page; it opens the page to nobody"
        ui.notify(told)
    else:
        _show_link(link)


async def _is_copied(text: str) -> bool:
    """Whether the browser, which has begun to copy, says that the text is on its clipboard."""
    try:
        return bool(await ui.run_javascript(f"(tellLink({json.dumps(text)}), linkCopied)", timeout=ANSWER_WITHIN))
    except TimeoutError:
        return False


def _show_link(link: str) -> None:
    """For the person to copy by hand."""
    with ui.dialog(value=True) as dialog, ui.card().classes("vs-dialog"):
        ui.label(_NOT_COPIED)
        ui.input("link to this scene", value=link).props("readonly dense autofocus").classes("w-full")
        ui.button("close", on_click=dialog.close).props("flat no-caps")
    dialog.on("hide", dialog.delete)
