"""Which picture is saved: a finished one of the whole volume, or none, and then it is said why."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, cast

import numpy as np
import pytest

from support.scenes.arbitrary import plain_scene
from volsplat.client.coordinator.events.instructions import FrameOutcome
from volsplat.client.coordinator.server_states import VolumeIncomplete
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.ui.viewing.finished_picture import FinishedPicture
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Feed, Troubles, Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import PeerLost, VolsplatError

LOST = Box((0, 0, 0), (4, 4, 4))
EMPTY = PublishedImage.of(np.zeros((64, 64, 4)))


class Ended:
    """A session, or its loop, as far as they are asked."""

    failure: VolsplatError | None = None
    shown: Picture | None = None


class Saved:
    """A viewing whose pictures and troubles a test tells."""

    def __init__(self) -> None:
        self.session, self.loop = Ended(), Ended()
        session, loop = cast(Any, self.session), cast(Any, self.loop)
        model = SceneModel(plain_scene())
        nothing = cast(Any, None)
        pictures: Feed[Picture] = Feed()
        troubles = Troubles()
        self.viewing = Viewing(session, model, loop, nothing, model.scene, pictures, troubles, "start volsplat again")
        pictures.attach(asyncio.get_running_loop())
        troubles.attach(asyncio.get_running_loop())

    def drawn(self, *missing: Box, healing: bool = False) -> Picture:
        """The finest picture of the scene as it is, which is told as well."""
        servers = FrameOutcome({}, {}, missing, healing)
        outcome = StepOutcome(Step.F, 0.0, 0.0, servers)
        picture = Picture(1, self.viewing.model.now, Step.F, EMPTY, outcome)
        self.loop.shown = picture
        self.viewing.pictures.tell(picture)
        return picture

    async def asks(self) -> asyncio.Task[Picture]:
        """What was told has come by then, and what is asked for now waits."""
        await all_told()
        waiting = asyncio.create_task(FinishedPicture(self.viewing).wait())
        await all_told()
        return waiting


async def all_told() -> None:
    """What was told has come, and whoever waited for it has gone on."""
    for _ in range(5):  # by one future to the next
        await asyncio.sleep(0)


def in_loop(test: Callable[[], Coroutine[Any, Any, None]]) -> Callable[[], None]:
    """A test that is run by an event loop of its own."""
    return lambda: asyncio.run(test())


@in_loop
async def test_a_finished_picture_is_there_at_once_and_one_that_is_drawn_is_waited_for() -> None:
    saved = Saved()
    waiting = await saved.asks()
    first = saved.drawn()
    assert await waiting is first
    saved.session.failure = PeerLost("gone")  # what is finished can be saved all the same
    assert await (await saved.asks()) is first


@in_loop
async def test_a_picture_that_lacks_a_part_is_refused() -> None:
    saved = Saved()
    saved.drawn(LOST)
    with pytest.raises(VolumeIncomplete, match="of the volume are missing"):
        await (await saved.asks())


@in_loop
async def test_while_others_take_over_the_next_picture_is_waited_for() -> None:
    saved = Saved()
    saved.drawn(LOST, healing=True)
    waiting = await saved.asks()
    saved.drawn(LOST, healing=True)
    await all_told()
    assert not waiting.done()
    whole = saved.drawn()
    assert await waiting is whole


@in_loop
async def test_what_is_drawn_anew_after_a_loss_is_waited_for() -> None:
    saved = Saved()
    saved.drawn(LOST)
    saved.loop.shown = None
    waiting = await saved.asks()
    whole = saved.drawn()
    assert await waiting is whole


@in_loop
async def test_a_picture_of_an_older_scene_is_none() -> None:
    saved = Saved()
    old = saved.drawn()
    saved.viewing.model.change(lambda scene: scene, settled=False)
    waiting = await saved.asks()
    saved.viewing.pictures.tell(old)
    await all_told()
    assert not waiting.done()
    saved.viewing.model.change(lambda scene: scene)
    new = saved.drawn()
    assert await waiting is new


@in_loop
async def test_waiting_ends_when_the_session_fails() -> None:
    saved = Saved()
    waiting = await saved.asks()
    saved.session.failure = PeerLost("the splat server is gone")
    saved.viewing.troubles.tell(Trouble("the splat server is gone", lasting=True))
    with pytest.raises(PeerLost, match="the splat server is gone; start volsplat again"):
        await waiting
    with pytest.raises(PeerLost, match="the splat server is gone"):
        await (await saved.asks())


@in_loop
async def test_waiting_ends_when_the_scene_cannot_be_drawn() -> None:
    saved = Saved()
    waiting = await saved.asks()
    saved.viewing.troubles.tell(Trouble("something else"))
    await all_told()
    assert not waiting.done()
    saved.loop.failure = VolsplatError("this image needs 3 GB of memory")
    saved.viewing.troubles.tell(Trouble("this image needs 3 GB of memory"))
    with pytest.raises(VolsplatError, match="no finished picture: this image needs 3 GB"):
        await waiting
    with pytest.raises(VolsplatError, match="no finished picture: this image needs 3 GB"):
        await (await saved.asks())


@in_loop
async def test_waiting_ends_when_another_volume_is_shown() -> None:
    saved = Saved()
    waiting = await saved.asks()
    saved.viewing.left()
    with pytest.raises(VolsplatError, match="another volume is shown"):
        await waiting
