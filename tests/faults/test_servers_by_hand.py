"""The only server of a kind is lost that a person has started by hand: another one is waited for."""

import signal
from pathlib import Path

import pytest
import torch

from support.files.head_volume import head, scene, single
from support.patience import wait_until
from support.programs.resident_servers import MAPSHADE, SPLAT, opened
from volsplat.client import Session
from volsplat.client.session.links import server_links
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import PeerLost

__all__ = ["head", "scene", "single"]


def wait_for_a_loss(session: Session) -> None:
    wait_until(lambda: any(server.lost for server in session.servers), "is it lost")


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_another_one_that_is_started_draws(head: Path, single: SingleProcess, scene: Scene, program: str) -> None:
    with opened(head, workers=1, splat_servers=1) as servers:
        servers.session.render(scene)
        servers.of[program][0].kill()
        wait_for_a_loss(servers.session)
        servers.join(program)
        assert torch.equal(servers.session.render(scene), single.render(scene))


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_one_that_was_frozen_joins_again_and_draws(
    head: Path, single: SingleProcess, scene: Scene, program: str
) -> None:
    with opened(head, workers=1, splat_servers=1) as servers:
        servers.session.render(scene)
        frozen = servers.of[program][0]
        frozen.send_signal(signal.SIGSTOP)
        wait_for_a_loss(servers.session)
        frozen.send_signal(signal.SIGCONT)
        assert torch.equal(servers.session.render(scene), single.render(scene))


@pytest.mark.parametrize("program", [MAPSHADE, SPLAT])
def test_if_none_joins_the_session_ends_and_says_which_was_lost_and_how(
    head: Path, scene: Scene, program: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_links, "ANOTHER_SECONDS", 0.5)
    with opened(head, workers=1, splat_servers=1) as servers:
        servers.session.render(scene)
        servers.of[program][0].kill()
        with pytest.raises(PeerLost, match=r"gone.*; no other (map/shade|splat) server has joined for 0.5 s"):
            servers.session.render(scene)
