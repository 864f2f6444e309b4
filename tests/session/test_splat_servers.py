"""Several splat servers, real ones: whatever shares out the image, its bits are those of the single process."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import msgspec
import pytest
import torch

from support.files.head_volume import head, scene, single
from support.files.prepared import prepare_small
from volsplat.client import Session
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.frame_links import links_of
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Image, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.refinement import PAPER_STEPS

__all__ = ["head", "scene", "single"]

SERVERS = [(1, 3), (2, 1), (2, 3), (3, 2), (4, 1), (4, 3)]  # splat and map/shade servers: fewer of one or the other
UPRIGHT, TURNED, SKEW = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.6, 0.8), (0.3, -0.4, 0.5, 0.7)
SMALLER_THAN_A_TILE_EACH = Image(width=61, height=9)  # not every region has a line


@pytest.fixture(scope="module")
def prepared(head: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("stores") / "head.zarr"
    prepare_small(head, store)
    return store


@pytest.fixture(scope="module", params=SERVERS, ids=lambda servers: f"{servers[0]} splat, {servers[1]} map/shade")
def session(head: Path, request: pytest.FixtureRequest) -> Iterator[Session]:
    splat_servers, workers = request.param
    threads = 2 * max(splat_servers, workers) + 1  # shared out unevenly, two or three for each
    with Session(head, workers=workers, splat_servers=splat_servers, threads=threads) as session:
        yield session


def looks(scene: Scene) -> Iterator[Scene]:
    """Scenes that are cut into regions in every way."""
    for order, rotation in product(TRAVERSAL_ORDERS, (UPRIGHT, TURNED, SKEW)):
        norm = sum(part * part for part in rotation) ** 0.5
        x, y, z, w = (part / norm for part in rotation)
        view = msgspec.structs.replace(scene.view, rotation=(x, y, z, w))
        yield msgspec.structs.replace(scene, order=order, view=view)
    edged = msgspec.structs.replace(scene.image, edges=True)
    yield msgspec.structs.replace(scene, image=edged)
    yield msgspec.structs.replace(scene, image=SMALLER_THAN_A_TILE_EACH)
    yield msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=0.3))


def test_the_image_is_the_same_for_any_splat_servers_workers_and_threads(
    session: Session, single: SingleProcess, scene: Scene
) -> None:
    for look in looks(scene):
        for step in (Step.A, Step.C, Step.F):
            assert torch.equal(session.render(look, step), single.render(look, step)), (look.view, look.image, step)


def test_every_step_is_refined_to_the_same_image_and_partial_ones_are_whole_images(
    session: Session, single: SingleProcess, scene: Scene
) -> None:
    finished = []
    for refinement in session.refine(scene, partial_interval=0.001):
        assert refinement.image.shape == (scene.image.height, scene.image.width, 4)
        assert refinement.undrawn == ()
        if refinement.complete:
            finished.append(refinement.step)
            assert torch.equal(refinement.image, single.render(scene, refinement.step))
    assert finished == list(PAPER_STEPS)


def test_a_report_has_every_server(session: Session, scene: Scene) -> None:
    outcome = session.finish(scene).outcome
    assert outcome is not None
    servers = {role: {server.id for server in session.servers if server.role is role} for role in Role}
    links = list(links_of(outcome))
    assert len(links) == len(servers[Role.SPLAT_SERVER]) * (len(servers[Role.MAPSHADE_SERVER]) + 1)
    for stats in outcome.servers.map_shade.values():
        assert sum(link.bytes for link in stats.links.values()) == stats.bytes
        assert sum(link.raw_bytes for link in stats.links.values()) == stats.raw_bytes
    assert set(outcome.servers.splat) == servers[Role.SPLAT_SERVER]
    assert set(outcome.servers.map_shade) == servers[Role.MAPSHADE_SERVER]
    sent, came = (
        sum(server.packets for server in of_role.values())
        for of_role in (outcome.servers.map_shade, outcome.servers.splat)
    )
    assert sent == came > 0


def test_an_abort_is_acknowledged_by_all_and_the_next_frame_is_whole(
    session: Session, single: SingleProcess, scene: Scene
) -> None:
    big = msgspec.structs.replace(scene, image=Image(width=700, height=700))
    refinement = session.refine(big, partial_interval=0.001)
    next(refinement)
    session.abort()
    list(refinement)
    assert torch.equal(session.render(scene), single.render(scene))


def test_a_probe_sees_what_the_single_process_does(session: Session, single: SingleProcess, scene: Scene) -> None:
    places = [(x, y) for x in range(5, 96, 30) for y in range(5, 80, 25)]
    assert [session.probe(scene, *place) for place in places] == [single.probe(scene, *place) for place in places]


def test_workers_that_fill_a_splat_server_each_do_not_wait_for_each_other(tmp_path: Path, scene: Scene) -> None:
    """The upper half of the volume is one worker's and one splat server's, the lower half the others'.

    Neither splat server gets on before it has heard from the worker that has nothing for it, while far more waits than
    it takes in.
    """
    side = 256
    path = tmp_path / "fog.nrrd"
    values = torch.randint(1, 256, (side, side, side), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))
    write_volume(path, values, Geometry(dims=(side, side, side)))
    tables = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=((0.0, 0.02),)))
    with (
        SingleProcess(path, threads=2) as single,
        Session(path, workers=2, splat_servers=2, threads=16) as session,
    ):
        for rotation in (UPRIGHT, (0.0, 0.0, 0.5**0.5, 0.5**0.5)):
            fog = Scene(tables=tables, view=View(rotation=rotation, zoom=0.5), image=Image(width=128, height=128))
            assert torch.equal(session.render(fog, Step.C), single.render(fog, Step.C))


@pytest.mark.parametrize("zoom", [0.4, 1.0, 2.5])
def test_a_prepared_volume_is_the_same_at_every_level(prepared: Path, scene: Scene, zoom: float) -> None:
    looked = msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=zoom))
    with Session(prepared, workers=2, splat_servers=3, threads=5) as session, SingleProcess(prepared) as single:
        for step in PAPER_STEPS:
            assert torch.equal(session.render(looked, step), single.render(looked, step)), step
