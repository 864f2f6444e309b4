"""The page's buttons that open the volume before or after the one that is shown: the next step of a series."""

from __future__ import annotations

import asyncio

from nicegui import context, ui

from volsplat.client.ui.controls.scene_upload import tell_trouble
from volsplat.client.ui.opening.opening import Keep, News, Opening
from volsplat.client.ui.opening.phantom_files import GivenUp
from volsplat.protocol.text.errors import VolsplatError

BUTTONS = {"chevron_left": ("the volume before", "Page Up", -1), "chevron_right": ("the next volume", "Page Down", 1)}


class NextVolume:
    """One tab's. What is opened so looks as what was shown, if it is of the same series."""

    def __init__(self, opening: Opening) -> None:
        self._opening = opening
        self._stepping = False
        self._buttons = [self._button(icon, *told) for icon, told in BUTTONS.items()]
        self._tell(opening.now)
        context.client.on_delete(opening.news.subscribe(self._tell))

    def _button(self, icon: str, what: str, key: str, further: int) -> ui.button:
        button = ui.button(icon=icon, color=None, on_click=lambda: self._step_once(further))
        button.props(f"flat dense round aria-label='open {what}'")
        button.classes(f"vs-icon-button vs-{key.replace(' ', '-').lower()}")
        return button.tooltip(f"open {what} of this file or folder, seen likewise ({key})")

    async def _step_once(self, further: int) -> None:
        """A second press may come before the buttons are seen to be disabled."""
        if self._stepping:
            return
        self._stepping = True
        try:
            await self._step(further)
        except GivenUp as error:
            ui.notify(str(error))
        except VolsplatError as error:
            tell_trouble(str(error))
        finally:
            self._stepping = False

    async def _step(self, further: int) -> None:
        place = await asyncio.to_thread(self._opening.beside, further)
        if isinstance(place, str):
            ui.notify(place)
        else:
            await self._opening.open(place, Keep.LOOK)

    def _tell(self, news: News) -> None:
        for button in self._buttons:
            button.set_enabled(not news.opening)
