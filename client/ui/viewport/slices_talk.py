"""The three slices beside one viewport's picture: read anew as what they show changes, one after the other.

They wait for the hand: while a person turns the volume nothing of them changes, and while tables move they stay as they
were. What the page has not yet shown holds back the next one, so that a slow line has no queue of them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from volsplat.client.caller.arguments import GRID_AXES
from volsplat.client.slices.slice_picture import slice_picture
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.picture_encoding import png_of
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.ui.viewport.message_base import framed
from volsplat.client.ui.viewport.slice_messages import SlicesAsked, VoxelTold, slice_header, voxel_told
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import SCREEN_FIELDS
from volsplat.protocol.description.volume import Index
from volsplat.protocol.text.errors import VolsplatError

log = logging.getLogger(__name__)

NONE = SlicesAsked(None, False, 1)


class SlicesTalk:
    """`send` is given the bytes of a slice. All calls come from the event loop's thread."""

    def __init__(self, viewing: Viewing, send: Callable[[bytes], None]) -> None:
        self._viewing = viewing
        self._send = send
        self._asked = NONE
        self._told: list[object] = [None, None, None]  # by axis: what decided the slice that was told last
        self._parts: list[VolumeSlice | None] = [None, None, None]
        self._level = 0  # of a prepared volume, that is drawn
        self._next = 0  # the axis whose turn it is
        self._shown = asyncio.Event()
        self._telling: asyncio.Task[None] | None = None

    def asked(self, asked: SlicesAsked) -> None:
        """Raises ValueError for a voxel that the volume does not have."""
        dims = self._viewing.volume.description.geometry.dims
        if asked.at is not None and not all(0 <= n < size for n, size in zip(asked.at, dims, strict=True)):
            raise ValueError(f"the volume has no voxel {asked.at}")
        if asked.at is None:
            self._told = [None, None, None]
        self._asked = asked
        self._wake()

    def shown(self) -> None:
        self._shown.set()

    def on_scene(self, state: SceneState) -> None:
        if state.settled:
            self._wake()

    def on_picture(self, picture: Picture) -> None:
        """A finished one says which level is held, and whether anything is missing that slices lack as well."""
        if not picture.last or picture.outcome is None:
            return
        self._level = picture.outcome.servers.level
        if not picture.outcome.servers.missing:
            for axis, part in enumerate(self._parts):
                if part is not None and not part.held.all():
                    self._told[axis] = None
        self._wake()

    def voxel(self, index: Index) -> VoxelTold:
        holding = (part for part in self._parts if part is not None and part.voxel(index) is not None)
        return voxel_told(index, next(holding, None), self._viewing.volume, self._viewing.model.scene.quantise)

    def end(self) -> None:
        self._asked = NONE
        if self._telling is not None:
            self._telling.cancel()

    def _wake(self) -> None:
        idle = self._telling is None or self._telling.done()
        if idle and self._asked.at is not None:
            self._telling = asyncio.get_running_loop().create_task(self._tell())

    async def _tell(self) -> None:
        """Until all three are told as they are wanted by then."""
        while (axis := self._lacking()) is not None:
            asked, scene = self._asked, self._viewing.model.scene
            assert asked.at is not None
            decides, index = self._decides(axis), asked.at[axis]
            try:
                part = await asyncio.to_thread(
                    self._viewing.session.read_slice, scene, GRID_AXES[axis], index, asked.longest
                )
                png = await asyncio.to_thread(_png, part, asked.coloured)
            except VolsplatError as error:  # whoever draws the picture tells it; the next one wakes this again
                log.info("no slice across %s: %s", GRID_AXES[axis], error)
                return
            self._told[axis], self._parts[axis], self._next = decides, part, axis + 1
            self._shown.clear()
            self._send(framed(slice_header(part, index), png))
            await self._shown.wait()

    def _lacking(self) -> int | None:
        """The next axis whose slice is not told as it is wanted; each has its turn."""
        if self._asked.at is None:
            return None
        turns = ((self._next + n) % 3 for n in range(3))
        return next((axis for axis in turns if self._told[axis] != self._decides(axis)), None)

    def _decides(self, axis: int) -> object:
        """All that the slice depends on."""
        asked, state = self._asked, self._viewing.model.now
        assert asked.at is not None
        place = (asked.at[axis], asked.coloured, asked.longest, self._level)
        return (*place, _look(state.scene, asked.coloured))


def _png(part: VolumeSlice, coloured: bool) -> bytes:
    return png_of(slice_picture(part, coloured))


def _look(scene: Scene, coloured: bool) -> object:
    """What of a scene its slices show."""
    if not coloured:
        return scene.quantise
    if scene.plane.patches:
        return (scene.quantise, scene.plane, scene.shading)
    cross_bar = scene.cross_bar
    by_screen = set(SCREEN_FIELDS) & {cross_bar.emit, cross_bar.refl, cross_bar.opac, cross_bar.modu}
    view = (scene.view, scene.image) if by_screen else None
    return (scene.quantise, scene.tables, cross_bar, scene.shading, view)
