"""The picture that is saved: finished, and of the whole volume."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack

from volsplat.client.coordinator.server_states import VolumeIncomplete
from volsplat.client.session.renderer import Refinement, finished_whole
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.text.errors import PeerLost, VolsplatError

_LEFT = "another volume is shown by now; save its picture instead"


class FinishedPicture:
    """The newest picture if nothing finer will follow and all of the volume is in it, else the next that is so."""

    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._asked = viewing.model.now.revision
        self._found: asyncio.Future[Picture] = asyncio.get_running_loop().create_future()
        newest = viewing.pictures.newest
        if newest is not None and not (_lacks(newest) and viewing.loop.shown is None):
            self._see(newest)  # else the same scene is being drawn anew, with what was lost
        if not self.is_known:
            self._look_for_end()

    @property
    def is_known(self) -> bool:
        """Whether there is nothing to wait for."""
        return self._found.done()

    def cancel(self) -> None:
        """Nobody waits for it any more."""
        self._found.cancel()

    async def wait(self) -> Picture:
        """It, once it is there.

        Raises VolumeIncomplete if a part of the volume is gone for good, and VolsplatError if it will never be there.
        """
        with ExitStack() as subscriptions:
            subscriptions.callback(self._viewing.pictures.subscribe(self._see))
            subscriptions.callback(self._viewing.troubles.subscribe(self._hear))
            subscriptions.callback(self._viewing.on_left(lambda: self._fail(VolsplatError(_LEFT))))
            return await self._found

    def _see(self, picture: Picture) -> None:
        if self.is_known or not picture.last or picture.state.revision < self._asked:
            return
        try:
            if _whole(picture):
                self._found.set_result(picture)
        except VolumeIncomplete as error:
            self._fail(error)

    def _hear(self, _trouble: Trouble) -> None:
        self._look_for_end()

    def _look_for_end(self) -> None:
        ended, failure = self._viewing.session.failure, self._viewing.loop.failure
        if ended is not None:
            self._fail(PeerLost(f"there is no finished picture: {ended}; {self._viewing.cure}"))
        elif failure is not None:
            self._fail(VolsplatError(f"there is no finished picture: {failure}"))

    def _fail(self, error: VolsplatError) -> None:
        if not self.is_known:
            self._found.set_exception(error)


def _lacks(picture: Picture) -> bool:
    """Whether a part of the volume is missing."""
    return picture.outcome is not None and bool(picture.outcome.servers.missing)


def _whole(picture: Picture) -> bool:
    """Whether it shows the whole volume. Raises VolumeIncomplete if none ever will."""
    refinement = Refinement(picture.step, picture.published, picture.outcome, picture.undrawn)
    return bool(list(finished_whole([refinement])))
