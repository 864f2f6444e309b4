"""What is asked of the servers under a pointer that moves on: one thing at a time, and the newest."""

from __future__ import annotations

import asyncio
import json
import threading
from types import SimpleNamespace
from typing import Any, cast

from support.patience import PATIENCE
from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.image_size import ImageSize
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewport.viewport_talk import ViewportTalk
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry, VolumeDescription

DESCRIPTION = VolumeDescription(name="head", format="NRRD", geometry=Geometry(dims=(8, 9, 10)), scalar_type="uint8")


class SlowServers:
    """Answer what was asked first once they may."""

    def __init__(self) -> None:
        self.may = threading.Event()
        self.asked: list[float] = []

    def probe(self, scene: Scene, x: float, y: float) -> None:
        self.asked.append(x)
        assert self.may.wait(PATIENCE)


def test_only_the_newest_place_and_those_that_were_picked_are_asked_for() -> None:
    servers, told = SlowServers(), list[float]()

    async def moving() -> None:
        everything = asyncio.Event()

        def tell(message: str | bytes) -> None:
            told.append(json.loads(message)["x"])
            if told[-1] == 9:
                everything.set()

        viewing = SimpleNamespace(
            session=servers,
            model=SceneModel(plain_scene()),
            image_size=ImageSize(),
            volume=SimpleNamespace(description=DESCRIPTION),
        )
        talk = ViewportTalk(cast(Any, viewing), "a tab", tell)
        for x in range(10):
            talk.heard(json.dumps({"type": "probe", "x": x, "y": 2, "picked": x == 5}))
            await asyncio.sleep(0)
        servers.may.set()
        await asyncio.wait_for(everything.wait(), PATIENCE)

    asyncio.run(moving())
    assert servers.asked == told == [0, 5, 9]
