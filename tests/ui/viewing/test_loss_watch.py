"""What the page tells of the only server of a kind that is lost, until another one draws."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from support.files.head_volume import head, scene, single
from support.patience import PATIENCE
from support.programs.resident_servers import MAPSHADE, SPLAT, Servers, opened
from volsplat.client.ui.viewing.loss_watch import watch_for_losses
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene

__all__ = ["head", "scene", "single"]


async def told_of_a_loss(viewing: Viewing, servers: Servers, program: str) -> list[Trouble]:
    """What is told from before the loss until the picture is whole again."""
    for feed in (viewing.pictures, viewing.troubles):
        feed.attach(asyncio.get_running_loop())
    watch = asyncio.create_task(watch_for_losses(viewing))
    servers.of[program][0].kill()
    told: list[Trouble] = []
    with_another = None
    async with asyncio.timeout(PATIENCE):
        viewing.troubles.subscribe(told.append)
        while not (told and "the picture is whole again" in told[-1].text):
            await asyncio.sleep(0.05)
            if told and with_another is None:
                with_another = asyncio.create_task(asyncio.to_thread(servers.join, program))
    watch.cancel()
    assert with_another is not None
    await with_another
    return told


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_another_one_is_awaited_in_words(head: Path, scene: Scene, program: str) -> None:
    with opened(head, workers=1, splat_servers=1) as servers:
        viewing = opened_viewing(servers.session, scene)
        viewing.loop.start()
        viewing.loop.wait_until_drawn()
        told = asyncio.run(told_of_a_loss(viewing, servers, program))
        viewing.loop.close()
    assert told[0].lasting and "server that joins within 60 s takes over" in told[0].text
    assert viewing.troubles.lasting is None
