"""A map/shade server whose walkers send to several splat servers, with the test as its client and as these."""

import socket
import threading
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import torch

from support.patience import PATIENCE, wait_until
from support.programs.hand_started import free_port
from support.programs.mapshade_bench import KEY, SCENE, Bench, probe, render
from support.scenes.arbitrary import plain_scene
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.links.splat_links import SplatLinks
from volsplat.protocol.description.scene import Order, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, new_tile_map
from volsplat.protocol.text.errors import PeerLost
from volsplat.protocol.wire.addresses import LOOPBACK
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.encryption import Encryption
from volsplat.protocol.wire.heartbeat import Heartbeat

SIZE = 16
WALKERS = 3
LARGE = 160
SIZE_OF_LARGE = (320, 320)
BRIEF = 1.0  # seconds of silence; a handshake has two of them


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def shells(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "shells.mha"
    write_volume(path, *make_phantom("shells", size=(SIZE,) * 3))
    return path


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its packets are more than links hold."""
    path = tmp_path_factory.mktemp("volumes") / "full.mha"
    write_volume(path, torch.full((LARGE,) * 3, 200, dtype=torch.uint8), Geometry((LARGE,) * 3))
    return path


def batches_on(link: Connection, walkers: int) -> dict[int, list[messages.Batch]]:
    """All that comes of a frame, by walker."""
    of_walkers: dict[int, list[messages.Batch]] = defaultdict(list)
    while sum(batches[-1].last for batches in of_walkers.values()) < walkers:
        received = link.receive()
        assert received is not None and isinstance(received.message, messages.Batch)
        of_walkers[received.message.walker].append(received.message)
    return of_walkers


def packets(of_walkers: dict[int, list[messages.Batch]]) -> int:
    return sum(part.packet_count for batches in of_walkers.values() for batch in batches for part in batch.parts)


def test_each_splat_server_gets_the_parts_of_its_regions_from_every_walker(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0, 1)
    owners = {2: 1, 3: 2}
    with bench.accepts(0) as first, bench.accepts(1) as second:
        for frame in (1, 2):
            bench.control.send(render(frame, geometry, SCENE, 1, WALKERS, owners))
            mapped = bench.hears(messages.FrameMapped)
            assert isinstance(mapped, messages.FrameMapped) and mapped.lost == []
            sent = 0
            for link, regions in zip((first, second), owners.values(), strict=True):
                of_walkers = batches_on(link, WALKERS)
                sent += packets(of_walkers)
                assert set(of_walkers) == set(range(WALKERS))
                for batches in of_walkers.values():
                    assert [batch.sequence for batch in batches] == list(range(len(batches)))
                    assert {len(batch.parts) for batch in batches} == {regions}
                    assert {batch.frame for batch in batches} == {frame}
            assert sent == mapped.stats.packets > 0


def test_a_frame_goes_on_without_a_splat_server_that_is_lost(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0, 1)
    with bench.accepts(0) as first:
        bench.accepts(1).close()
        wait_until(lambda: bench.linked == [2], "noticed the loss")
        bench.control.send(render(1, geometry, SCENE, 1, WALKERS, {2: 1, 3: 1}))
        mapped = bench.hears(messages.FrameMapped)
        assert isinstance(mapped, messages.FrameMapped) and mapped.lost == [3]
        assert packets(batches_on(first, WALKERS)) > 0


def test_of_a_frame_for_splat_servers_that_are_all_lost_the_client_hears_so(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0, 1)
    for number in (0, 1):
        bench.accepts(number).close()
    wait_until(lambda: bench.linked == [], "noticed the losses")
    bench.control.send(render(1, geometry, SCENE, 1, WALKERS, {2: 1, 3: 1}))
    mapped = bench.hears(messages.FrameMapped)
    assert isinstance(mapped, messages.FrameMapped) and mapped.lost == [2, 3]


def test_a_frame_of_a_splat_server_that_was_not_named_goes_on_without_it(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0)
    with bench.accepts(0) as first:
        bench.control.send(render(1, geometry, SCENE, 1, 1, {2: 1, 3: 1}))
        mapped = bench.hears(messages.FrameMapped)
        assert isinstance(mapped, messages.FrameMapped) and mapped.lost == [3]
        batches_on(first, 1)


def test_each_splat_server_tells_which_tiles_of_its_lines_are_closed(bench: Bench, full: Path) -> None:
    width, height = SIZE_OF_LARGE
    geometry = bench.holds(full, 1)
    bench.connects(0, 1)
    opaque = plain_scene(view=View(zoom=1.0), size=SIZE_OF_LARGE, order=Order.FRONT_TO_BACK)
    request = render(1, geometry, opaque, 1, 1, {2: 1, 3: 1})
    edge = request.regions[0].end
    assert 0 < edge < height and edge % TILE_SIDE == 0
    with bench.accepts(0) as first, bench.accepts(1) as second:
        before = bench.heard
        bench.control.send(request)
        begun = first.receive()
        assert begun is not None and isinstance(begun.message, messages.Batch)
        for link, begin, end in ((first, 0, edge), (second, edge, height)):
            closed = new_tile_map(width, end - begin).cast("B")
            closed[:] = b"\xff" * len(closed)
            link.send(messages.TilesClosed(1, width, begin, end), closed)
        wait_until(lambda: bench.heard == before + 2, "heard of all tiles")
        with ThreadPoolExecutor() as pool:  # the walker may be held up by either before it looks at the tiles
            of_first, of_second = pool.map(lambda link: batches_on(link, 1), (first, second))
        mapped = bench.hears(messages.FrameMapped)
    assert isinstance(mapped, messages.FrameMapped)
    sent = begun.message.parts[0].packet_count + packets(of_first) + packets(of_second)
    assert sent == mapped.stats.packets < LARGE**3


def test_a_probe_is_answered_while_all_walkers_are_held_up(bench: Bench, full: Path) -> None:
    geometry = bench.holds(full, 1)
    bench.connects(0)
    scene = plain_scene(view=View(zoom=1.0), size=SIZE_OF_LARGE)
    with bench.accepts(0) as link:
        bench.control.send(render(1, geometry, scene, 1, WALKERS))
        bench.control.send(probe(geometry, scene))
        probed = bench.hears(messages.VoxelProbed)
        of_walkers = batches_on(link, WALKERS)
        mapped = bench.hears(messages.FrameMapped)
    assert isinstance(probed, messages.VoxelProbed) and probed.voxel is not None and probed.voxel.density == 200.0
    assert isinstance(mapped, messages.FrameMapped) and packets(of_walkers) == mapped.stats.packets == LARGE**3


def test_an_abort_ends_all_walkers(bench: Bench, full: Path, shells: Path) -> None:
    geometry = bench.holds(full, 1)
    bench.connects(0)
    with bench.accepts(0) as link:
        bench.control.send(render(1, geometry, plain_scene(view=View(zoom=1.0), size=SIZE_OF_LARGE), 1, WALKERS))
        assert link.receive() is not None
        bench.control.send(messages.AbortFrame(1))
        bench.control.send(render(2, geometry, SCENE, 1, WALKERS))
        of_second: dict[int, bool] = {}
        while sum(of_second.values()) < WALKERS:
            received = link.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            batch = received.message
            if batch.frame == 2:
                of_second[batch.walker] = batch.last
            else:
                assert batch.frame == 1 and not of_second
        bench.hears(messages.FrameAborted)
        bench.hears(messages.FrameMapped)


def test_a_splat_server_that_cannot_be_reached_is_done_without(bench: Bench) -> None:
    there = bench.splat_servers[0].address
    # Given up, so that nobody is dialled twice.
    links = SplatLinks(bench.token, lambda: True, Heartbeat(), Encryption.BETWEEN_MACHINES)
    nobody, unknown = messages.Route(9, there.host, free_port(), KEY), messages.Route(8, "nowhere.invalid", 7, KEY)
    links.connect([nobody, unknown, messages.Route(2, there.host, there.port, KEY)], 1)
    assert list(links.of_servers) == [2]
    with pytest.raises(PeerLost, match="nobody listens"):
        links.connect([nobody], 1)
    assert not links.of_servers
    links.close()


def test_a_frozen_splat_server_is_dialled_no_more_once_the_client_has_given_it_up(bench: Bench) -> None:
    there = bench.splat_servers[0].address
    living = messages.Route(2, there.host, there.port, KEY)
    links = SplatLinks(bench.token, lambda: False, Heartbeat(BRIEF), Encryption.BETWEEN_MACHINES)
    with socket.create_server((LOOPBACK, 0)) as frozen:  # the system takes what it never answers
        silent = messages.Route(3, LOOPBACK, int(frozen.getsockname()[1]), KEY)
        connecting = threading.Thread(target=links.connect, args=([silent, living], 1), daemon=True)
        connecting.start()
        with frozen.accept()[0]:
            links.interrupt_except([living])
            connecting.join(PATIENCE)
        assert list(links.of_servers) == [2]
        frozen.setblocking(False)
        with pytest.raises(BlockingIOError):
            frozen.accept()
    links.close()


def test_splat_servers_that_do_not_answer_hold_up_nobody_that_comes_after_them(bench: Bench) -> None:
    links = SplatLinks(bench.token, lambda: False, Heartbeat(PATIENCE), Encryption.BETWEEN_MACHINES)
    with socket.create_server((LOOPBACK, 0)) as one, socket.create_server((LOOPBACK, 0)) as other:
        servers = [one, other]
        ports = [int(frozen.getsockname()[1]) for frozen in servers]
        silent = [messages.Route(number, LOOPBACK, port, KEY) for number, port in enumerate(ports, 3)]
        there = bench.splat_servers[0].address
        living = messages.Route(2, there.host, there.port, KEY)
        connecting = threading.Thread(target=links.connect, args=([*silent, living], 1), daemon=True)
        connecting.start()
        for frozen in servers:
            frozen.settimeout(PATIENCE)
        with one.accept()[0], other.accept()[0], bench.accepts(0):
            links.interrupt_except([living])
        connecting.join(PATIENCE)
        assert not connecting.is_alive() and list(links.of_servers) == [2]
    links.close()
