"""While others read what was lost with a map/shade server, a screen still sees what is left, from wherever it looks."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from support.files.head_volume import SMALL, skin
from support.files.loopback_files import Served, served
from support.patience import wait_until
from support.programs.server_processes import frozen, servers
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.session.renderer import Refinement
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene

zarr = pytest.importorskip("zarr")

BRIEF = 2.0  # seconds of silence


@pytest.fixture
def web(tmp_path: Path) -> Iterator[Served]:
    """Lends a head in chunks, volume.zarr, which it may hold back."""
    values = make_phantom("head", size=(32, 40, 36))[0]
    zarr.create_array(tmp_path / "volume.zarr", data=values.numpy(), chunks=(12, 16, 16))
    with served(tmp_path) as state:
        try:
            yield state
        finally:
            state.lets_go.set()


def first_image(session: Session, scene: Scene) -> Refinement:
    """What a screen shows first of a view."""
    refining = session.refine(scene, first=Step.F)
    try:
        return next(refinement for refinement in refining if refinement.complete)
    finally:
        refining.close()  # type: ignore[attr-defined]  # it is a generator


def missing_voxels(refinement: Refinement) -> int:
    assert refinement.outcome is not None
    return sum(box.voxels for box in refinement.outcome.servers.missing)


def test_frames_go_on_while_what_was_lost_is_read(web: Served) -> None:
    volume = f"{web.url}/volume.zarr"
    with SingleProcess(volume) as single, Session(volume, workers=2) as session:
        scene = skin(session, SMALL)
        expected = single.render(scene)
        assert torch.equal(session.render(scene), expected)
        web.lets_go.clear()
        servers(session, "mapshade_server")[0].kill()
        wait_until(lambda: any(server.lost for server in session.servers), "is the loss known")
        for degrees in (0, 40, 80, 120):
            seen = first_image(session, scene.with_(rotation=(degrees, 10)))
            assert missing_voxels(seen) and seen.outcome is not None and seen.outcome.servers.healing
            assert seen.image.any(), "what is left is not seen"
        web.lets_go.set()
        assert torch.equal(session.render(scene), expected)
        *_, whole = session.refine(scene, first=Step.F)
        assert torch.equal(whole.image, expected) and not missing_voxels(whole)


def test_a_server_that_freezes_while_it_reads_is_noticed_as_soon_as_any_other(web: Served) -> None:
    volume = f"{web.url}/volume.zarr"
    with SingleProcess(volume) as single, Session(volume, workers=3, silence=BRIEF) as session:
        scene = skin(session, SMALL)
        expected = single.render(scene)
        assert torch.equal(session.render(scene), expected)
        web.lets_go.clear()
        ended, freezing, _ = servers(session, "mapshade_server")
        ended.kill()
        first_image(session, scene)
        wait_until(lambda: len(web.waiting) >= 2, "do the others read what was lost")
        with frozen(freezing):
            wait_until(lambda: sum(server.lost for server in session.servers) == 2, "is the frozen one noticed")
            assert any("has said nothing for 2 s" in server.cause for server in session.servers)
            web.lets_go.set()
            assert torch.equal(session.render(scene), expected)
            assert sum(server.lost for server in session.servers) == 2, "who only waits for what it reads lives"
