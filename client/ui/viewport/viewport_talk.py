"""What is said between one viewport and the client's process, whatever carries it.

The page gets the newest picture only, and no more at once than its line holds: on a slow line the rate falls and the
lag does not grow.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Coroutine
from typing import Any, assert_never

import msgspec

from volsplat.client.scene.resized import sized
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.ui.viewport import viewport_messages as said
from volsplat.client.ui.viewport.slice_messages import SlicesAsked, SliceShown, VoxelAsked, VoxelTold, slice_value_told
from volsplat.client.ui.viewport.slices_talk import SlicesTalk
from volsplat.client.ui.viewport.under_way import UnderWay
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import asking_for_fit
from volsplat.client.volume.value_certainty import Certainty
from volsplat.protocol.description.scene import Bounds, Image, Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.geometry.upright import Up
from volsplat.protocol.rules.resolved_view import resolved_bounds
from volsplat.protocol.text.errors import VolsplatError

REST_SECONDS = 0.04  # that a pointer rests on, once its voxel is told, before the file is read for it

log = logging.getLogger(__name__)
replace = msgspec.structs.replace


class ViewportTalk:
    """One open viewport. `send` is given what to tell it: text (JSON) or bytes (a picture)."""

    def __init__(self, viewing: Viewing, tab: str, send: Callable[[str | bytes], None]) -> None:
        self._viewing = viewing
        self._image_size = viewing.image_size
        self._geometry = viewing.volume.description.geometry
        self._tab = tab
        self._send = send
        self._up: Up | None = None  # as the page was told,
        self._image: Image | None = None  # likewise
        self._sent = 0  # number of the last picture that was sent
        self._under_way = UnderWay()
        self._newest_probe = 0
        self._probing = asyncio.Lock()  # held while servers are asked what is under the pointer: once at a time
        self._reading_file = asyncio.Lock()  # held while the file is read for this viewport: once at a time
        self._tasks: set[asyncio.Task[None]] = set()
        self._subscriptions = contextlib.ExitStack()
        self._slices = SlicesTalk(viewing, send)

    def begin(self) -> None:
        """Tell all that there is, and from now on what changes."""
        self._on_scene(self._viewing.model.now)
        if self._viewing.troubles.lasting is not None:
            self._on_trouble(self._viewing.troubles.lasting)
        self._subscriptions.callback(self._viewing.model.subscribe(self._on_scene))
        self._subscriptions.callback(self._viewing.pictures.subscribe(self._on_picture))
        self._subscriptions.callback(self._viewing.troubles.subscribe(self._on_trouble))
        self._give_picture()

    def end(self) -> None:
        """The viewport is gone: what its person was at is settled, and the image has another window's size."""
        self._subscriptions.close()
        self._slices.end()
        for task in self._tasks:
            task.cancel()
        self._viewing.model.let_go(self._tab)
        self._image_size.closed(self)  # its tab may have another connection by now
        self._resize()

    # -- to the page

    def _say(self, message: said.ProcessMessage) -> None:
        self._send(msgspec.json.encode(message).decode())

    def _on_scene(self, state: SceneState) -> None:
        """Tell of the scene, and before it of the volume if that stands otherwise than was told.

        What this viewport's own hand is at it knows, and hears of when it is settled; not how large the image is, which
        is also another window's doing.
        """
        if state.by == self._tab and not state.settled and state.scene.image == self._image:
            return
        self._image = state.scene.image
        volume = self._viewing.volume
        up = volume.up_in(state.scene)
        if up != self._up:
            self._up = up
            self._say(said.volume_told(volume.description, up))
        try:
            self._say(said.scene_told(state, self._geometry, self._fit(state)))
        except ValueError as error:  # bounds or a centre that the volume does not have
            self._say(said.TroubleTold(str(error)))
        self._slices.on_scene(state)

    def _fit(self, state: SceneState) -> said.Fit | None:
        """Found out anew at every movement of the hand, it would delay the picture."""
        if not state.settled:
            return None
        view = self._viewing.volume.fitted_to_turn(asking_for_fit(state.scene)).view
        if isinstance(view.zoom, str) or isinstance(view.center, str):  # the volume has no such bounds
            return None
        return said.Fit(view.zoom, view.center)

    def _on_trouble(self, trouble: Trouble) -> None:
        self._say(said.TroubleTold(trouble.text, trouble.lasting))

    def _on_picture(self, picture: Picture) -> None:
        self._give_picture()
        self._slices.on_picture(picture)

    def _give_picture(self) -> None:
        picture: Picture | None = self._viewing.pictures.newest
        if picture is not None and picture.number > self._sent and self._under_way.may_send():
            self._sent = picture.number
            self._under_way.sent(picture.number, time.monotonic())
            self._send(said.picture_message(picture, self._tab, self._geometry, self._viewing.loop.pacing))

    # -- from the page

    def heard(self, text: str) -> None:
        """Do what the page says."""
        try:
            self._obey(said.page_message(text))
        except msgspec.MsgspecError as error:
            self._say(said.TroubleTold(f"the page said what cannot be understood: {error}"))
        except ValueError as error:
            self._say(said.TroubleTold(str(error)))

    def _obey(self, message: said.PageMessage) -> None:
        match message:
            case said.PictureShown(number=number):
                self._under_way.shown(number, time.monotonic())
                self._give_picture()
            case said.Size(width=width, height=height):
                told = self._image_size.came_back if message.again else self._image_size.opened_or_resized
                told(self, (width, height))
                self._resize()
            case said.ViewTurned(settled=settled, event=event):
                self._change(lambda s: _turned(s, message), settled, event)
            case said.BoundsMoved(settled=settled, event=event):
                bounds = Bounds(low=message.low, high=message.high)
                self._change(lambda s: self._cut(s, bounds), settled, event)
            case said.UndoAsked():
                self._viewing.model.undo(self._tab)
                self._use()
            case said.RedoAsked():
                self._viewing.model.redo(self._tab)
                self._use()
            case said.ProbeAsked(x=x, y=y, picked=picked):
                self._in_background(self._probe(x, y, picked))
            case said.CenterAsked(x=x, y=y):
                self._in_background(self._center(x, y))
            case SlicesAsked():
                self._slices.asked(message)
            case SliceShown():
                self._slices.shown()
            case VoxelAsked(index=index):
                self._in_background(self._voxel(index))
            case _:
                assert_never(message)

    def _change(self, edit: Callable[[Scene], Scene], settled: bool = True, event: int | None = None) -> None:
        """Change the scene, and have its image in this window's size."""
        self._image_size.used(self)
        self._viewing.model.change(
            lambda s: self._image_size.fitted(edit(s)), by=self._tab, settled=settled, event=event
        )

    def _use(self) -> None:
        self._image_size.used(self)
        self._resize()

    def _resize(self) -> None:
        """Have the image in the size that it should have; if it has that, nothing is drawn anew."""
        model = self._viewing.model
        if self._image_size.fitted(model.scene) != model.scene:
            model.resize(self._image_size.fitted, by=self._tab)

    def _cut(self, scene: Scene, bounds: Bounds) -> Scene:
        """Raises ValueError if the volume has no such bounds."""
        cut = replace(scene, bounds=bounds)
        resolved_bounds(cut, self._geometry)
        return cut

    def _in_background(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _probe(self, x: float, y: float, picked: bool) -> None:
        """Tell what is drawn there; and if the pointer rests, what the file has, which may take its time.

        Where the pointer has been meanwhile nobody need know, unless it was picked there.
        """
        self._newest_probe += 1
        number, scene = self._newest_probe, self._viewing.model.scene
        async with self._probing:
            if number != self._newest_probe and not picked:
                return
            try:
                found = await asyncio.to_thread(self._viewing.session.probe, scene, x, y)
            except VolsplatError as error:
                log.info("no value under the pointer: %s", error)
                return
        answer = said.probe_answered(x, y, found, scene, self._viewing.volume)
        self._say(answer)
        if found is None or not self._file_has_more(answer):
            return
        voxel = await self._file_voxel(number, found.index)
        if voxel is not None:
            self._say(said.file_value_told(x, y, voxel))

    async def _voxel(self, index: Index) -> None:
        """Likewise of a voxel that a slice shows."""
        self._newest_probe += 1
        number, told = self._newest_probe, self._slices.voxel(index)
        self._say(told)
        if told.found is None or not self._file_has_more(told):
            return
        voxel = await self._file_voxel(number, index)
        if voxel is not None:
            self._say(slice_value_told(index, voxel))

    def _file_has_more(self, told: said.ProbeAnswered | VoxelTold) -> bool:
        return told.density_is is not Certainty.EXACT or self._has_second_scalar

    @property
    def _has_second_scalar(self) -> bool:
        return self._viewing.volume.description.second_scalar is not None

    async def _file_voxel(self, number: int, index: Index) -> FileVoxel | None:
        """What the file has there, if the pointer rests; None if it does not, or that is not known soon."""
        await asyncio.sleep(REST_SECONDS)
        async with self._reading_file:
            if number != self._newest_probe:
                return None
            try:
                return await asyncio.to_thread(self._viewing.session.file_voxel, index)
            except VolsplatError as error:
                log.info("the file's own value is not known: %s", error)
                return None

    async def _center(self, x: float, y: float) -> None:
        scene = self._viewing.model.scene
        try:
            found = await asyncio.to_thread(self._viewing.session.probe, scene, x, y)
        except VolsplatError as error:
            self._say(said.TroubleTold(str(error)))
            return
        if found is None:
            return
        i, j, k = found.index
        center = (float(i), float(j), float(k))
        self._change(lambda s: replace(s, view=replace(s.view, center=center)))


def _turned(scene: Scene, told: said.ViewTurned) -> Scene:
    """The scene as the page would see it, which may know the image in another size than it has now."""
    known = sized(scene, width=told.width, height=told.height)
    view = replace(known.view, rotation=told.rotation, zoom=told.zoom, center=told.center)
    return sized(replace(known, view=view), width=scene.image.width, height=scene.image.height)
