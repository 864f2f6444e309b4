"""The newest picture where the viewport will stand: an image of the page itself, seen before any script has run."""

from __future__ import annotations

import asyncio

from nicegui import ui

from volsplat.client.ui.viewing.picture_encoding import preview
from volsplat.client.ui.viewing.viewing import Viewing

EARLY_PATH = "/early"  # where the image is fetched
PATIENCE = 5.0  # seconds that a browser waits for it


def early_picture() -> None:
    """Put it into the page that is being built; the viewport takes it over. It is fetched before the scripts are."""
    url = EARLY_PATH.removeprefix("/")
    ui.add_head_html(f'<link rel="preload" as="image" fetchpriority="high" href="{url}">')
    ui.add_body_html(f'<div class="vs-early"><img alt="" src="{url}"></div>')


async def early_image(viewing: Viewing) -> bytes | None:
    """The newest finished picture as JPEG, the first as soon as it is there; None if that takes too long."""
    try:
        picture = viewing.loop.shown
        if picture is None:
            picture = await asyncio.wait_for(viewing.pictures.next(lambda one: one.complete), PATIENCE)
    except TimeoutError:
        return None
    return await asyncio.to_thread(preview, picture.published, picture.state.scene.image.background)
