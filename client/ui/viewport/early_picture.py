"""The newest picture where the viewport will stand: an image of the page itself, seen before any script has run."""

from __future__ import annotations

import asyncio
import base64
from collections.abc import Callable

from nicegui import ui

from volsplat.client.ui.doors.waiting_page import EARLY_PATH
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.picture_encoding import preview
from volsplat.client.ui.viewing.viewing import Viewing

PATIENCE = 5.0  # seconds that a browser waits for it


def early_picture(viewing: Viewing) -> None:
    """Put it into the page that is being built; the viewport takes it over.

    Where there is none yet, it is fetched before the scripts are.
    """
    picture = viewing.loop.shown
    if picture is None:
        url = EARLY_PATH.removeprefix("/")
        ui.add_head_html(f'<link rel="preload" as="image" fetchpriority="high" href="{url}">')
    else:
        url = f"data:image/jpeg;base64,{base64.b64encode(_preview(picture)).decode()}"
    ui.add_body_html(f'<div class="vs-early"><img alt="" elementtiming="picture" decoding="sync" src="{url}"></div>')


async def early_image(viewing: Viewing) -> bytes | None:
    """The newest finished picture as JPEG, the first as soon as it is there; None if that takes too long."""
    try:
        picture = viewing.loop.shown
        if picture is None:
            picture = await asyncio.wait_for(viewing.pictures.next(lambda one: one.complete), PATIENCE)
    except TimeoutError:
        return None
    return await asyncio.to_thread(_preview, picture)


def show_first(viewing: Viewing, show: Callable[[bytes], None]) -> None:
    """Have the first finished picture shown, as JPEG, as soon as it is drawn. Before the loop starts."""
    viewing.loop.tell_first(lambda picture: show(_preview(picture)))


def _preview(picture: Picture) -> bytes:
    return preview(picture.published, picture.state.scene.image.background)
