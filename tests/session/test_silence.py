"""Servers that are frozen are noticed by their silence, and others take over; one that is only slow is not."""

from pathlib import Path

import psutil
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import wait_until
from support.programs.server_processes import frozen, servers
from volsplat.client import Session
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.messages.roles import Role

__all__ = ["head", "scene", "single"]

BRIEF = 2.0  # seconds of silence
SILENT = "has said nothing for 2 s: it is frozen, overloaded or cut off"
UNHEARD = "has no connection to"  # as servers that draw with it may find out first


def test_a_frozen_map_shade_server_is_lost_and_the_others_draw_all(
    head: Path, single: SingleProcess, scene: Scene
) -> None:
    with Session(head, workers=3, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, "mapshade_server")[1]):
            assert torch.equal(session.render(scene), single.render(scene))
            (lost,) = [server for server in session.servers if server.lost]
            assert (SILENT in lost.cause or UNHEARD in lost.cause) and lost.handed_over
        assert torch.equal(session.render(scene), single.render(scene)), "though it may speak again"


def test_of_two_splat_servers_one_that_is_frozen_is_done_without(
    head: Path, single: SingleProcess, scene: Scene
) -> None:
    with Session(head, workers=2, splat_servers=2, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, "splat_server")[0]):
            assert torch.equal(session.render(scene), single.render(scene))
            assert [server.role for server in session.servers if server.lost] == [Role.SPLAT_SERVER]


@pytest.mark.parametrize("program", ["mapshade_server", "splat_server"])
def test_in_the_place_of_the_only_one_another_is_started(
    head: Path, single: SingleProcess, scene: Scene, program: str
) -> None:
    with Session(head, workers=1, silence=BRIEF) as session:
        session.render(scene)
        (only,) = servers(session, program)
        only.suspend()
        assert torch.equal(session.render(scene), single.render(scene))
        wait_until(lambda: not only.is_running() or only.status() == psutil.STATUS_ZOMBIE, "is the frozen one ended")
        (lost,) = [server for server in session.servers if server.lost]
        assert SILENT in lost.cause or UNHEARD in lost.cause


@pytest.mark.parametrize("program", ["mapshade_server", "splat_server"])
def test_while_nobody_draws_a_frozen_server_is_noticed_as_well(head: Path, scene: Scene, program: str) -> None:
    with Session(head, workers=2, splat_servers=2, silence=BRIEF) as session:
        session.render(scene)
        with frozen(servers(session, program)[0]):
            wait_until(lambda: any(server.lost for server in session.servers), "is it noticed")
            (lost,) = [server for server in session.servers if server.lost]
            assert SILENT in lost.cause
