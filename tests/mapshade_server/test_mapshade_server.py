"""The map/shade server's loop over real sockets, with the test as its client and as its splat servers."""

import math
import socket
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec
import pytest
import torch

from support.messages.message_samples import SAMPLES
from support.patience import wait_until
from support.programs.mapshade_bench import KEY, SCENE, Bench, probe, render
from support.scenes.arbitrary import plain_scene
from support.scenes.phantoms import QUANTISATION
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.held.volume_identity import identified_volume
from volsplat.mapshade_server.held.wanted_reader import GivenUp
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.waiting_requests import WaitingRequests
from volsplat.protocol.description.scene import Order, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.closed_tiles import new_tile_map
from volsplat.protocol.text.errors import BadInput, PeerLost
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import Received

SIZE = 16


@pytest.fixture(scope="module")
def shells(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("volumes") / "shells.mha"
    write_volume(path, *make_phantom("shells", size=(SIZE,) * 3))
    return path


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_a_link_whose_route_is_unchanged_is_kept(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0)
    with bench.accepts(0) as link:
        bench.connects(0)
        bench.draws(1, geometry, link)


def test_a_new_route_ends_the_old_link(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0)
    with bench.accepts(0) as old:
        bench.connects(1)
        with pytest.raises(PeerLost):
            old.receive()
    with bench.accepts(1) as link:
        bench.draws(1, geometry, link, server=3)


def test_a_lost_link_is_dialled_again_on_the_same_route(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    bench.connects(0)
    bench.accepts(0).close()
    frame = 0
    while True:  # a send into a closed connection fails once its end has been heard of
        frame += 1
        bench.control.send(render(frame, geometry))
        received = bench.control.receive()
        assert received is not None and isinstance(received.message, messages.FrameMapped)
        assert received.message.frame == frame
        if received.message.lost:
            break
    bench.connects(0)
    with bench.accepts(0) as link:
        bench.draws(frame + 1, geometry, link)


def test_what_cannot_be_done_is_refused_in_one_line_and_the_server_goes_on(bench: Bench, shells: Path) -> None:
    geometry = Geometry(dims=(SIZE, SIZE, SIZE))
    assert "no such" in bench.refuses(messages.DescribeVolume("/absent.nrrd")).cause.lower()
    early = bench.refuses(render(1, geometry))
    assert early.frame == 1 and "assignment 1" in early.cause
    geometry = bench.holds(shells, 1)
    unlinked = bench.refuses(render(2, geometry))
    assert unlinked.frame == 2 and "no splat server" in unlinked.cause
    bench.connects(0)
    with bench.accepts(0) as link:
        larger = render(3, Geometry(dims=(SIZE, SIZE, SIZE + 1)))
        drawing = msgspec.structs.replace(larger.drawing, geometry=geometry)
        outside = bench.refuses(msgspec.structs.replace(larger, drawing=drawing))
        assert outside.frame == 3 and "bounds" in outside.cause
        bench.draws(4, geometry, link)


def test_a_reading_that_fails_leaves_nothing_that_a_frame_could_be_drawn_from(
    bench: Bench, shells: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(*_: object) -> None:
        raise BadInput("the disk is gone")

    geometry = bench.holds(shells, 1)
    monkeypatch.setattr("volsplat.mapshade_server.held_volume.SubCube.read", unreadable)
    bench.connects(0)
    with bench.accepts(0):
        failed = bench.refuses(messages.ReadSubCubes(2, str(shells), [geometry.box], identified_volume(str(shells))[1]))
        assert (failed.assignment, failed.held) == (2, 0)
        assert "is for assignment 1" in bench.refuses(render(1, geometry)).cause


def test_boxes_beyond_the_volume_and_other_assignments_lose_nothing(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    reader, identity = identified_volume(str(shells))
    boxes = [geometry.box, Geometry(dims=(4 * SIZE, SIZE, SIZE)).box]
    bench.connects(0)
    with bench.accepts(0) as link:
        for request, told in (
            (messages.ReadSubCubes(2, str(shells), boxes, identity), "beyond the volume"),
            (messages.AwaitParts(2, reader.description, boxes), "beyond the volume"),
            (messages.CountHistograms(2, 0.0, 1.0, 1.0), "is for assignment 2, not 1"),
            (messages.PackVoxels(2, QUANTISATION), "is for assignment 2, not 1"),
        ):
            refused = bench.refuses(request)
            assert told in refused.cause and refused.held == 1
        bench.draws(1, geometry, link)


def test_a_lost_client_ends_the_server_and_its_link(bench: Bench) -> None:
    bench.connects(0)
    with bench.accepts(0) as link:
        bench.control.close()
        bench.ends()
        assert isinstance(bench.failure, PeerLost)
        with pytest.raises(PeerLost):
            link.receive()


@pytest.mark.parametrize("of_frame", [2, 1], ids=["this frame", "the frame before"])
def test_what_lies_behind_closed_tiles_of_this_frame_is_left_out(bench: Bench, tmp_path: Path, of_frame: int) -> None:
    """The volume's packets are more than the link holds, so that most are still to be made when the news comes."""
    side, size = 160, (320, 320)
    volume = tmp_path / "full.mha"
    write_volume(volume, torch.full((side,) * 3, 200, dtype=torch.uint8), Geometry((side,) * 3))
    geometry = bench.holds(volume, 1)
    bench.connects(0)
    opaque = plain_scene(view=View(zoom=1.0), size=size, order=Order.FRONT_TO_BACK)
    with bench.accepts(0) as link:
        bench.control.send(render(2, geometry, opaque))
        first = link.receive()
        assert first is not None and isinstance(first.message, messages.Batch)
        tiles = new_tile_map(*size)
        tiles.cast("B")[:] = b"\xff" * tiles.nbytes
        link.send(messages.TilesClosed(of_frame, size[0], 0, size[1]), tiles.cast("B"))
        wait_until(lambda: bench.heard, "taken the news")
        packets, batch = first.message.parts[0].packet_count, first.message
        while not batch.last:
            received = link.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            batch = received.message
            packets += batch.parts[0].packet_count
        mapped = bench.hears(messages.FrameMapped)
    assert isinstance(mapped, messages.FrameMapped)
    assert packets == mapped.stats.packets
    assert packets < side**3 if of_frame == 2 else packets == side**3


def test_a_probe_is_answered_between_two_batches_of_a_frame(bench: Bench, tmp_path: Path) -> None:
    """The volume's packets are more than the link holds, so that the frame cannot end before they are taken."""
    side, size = 160, (320, 320)
    volume = tmp_path / "full.mha"
    write_volume(volume, torch.full((side,) * 3, 200, dtype=torch.uint8), Geometry((side,) * 3))
    geometry = bench.holds(volume, 1)
    bench.connects(0)
    scene = plain_scene(view=View(zoom=1.0), size=size)
    with bench.accepts(0) as link:
        before = bench.connection.counters.messages_in
        bench.control.send(render(1, geometry, scene))
        bench.control.send(probe(geometry, scene))
        wait_until(lambda: bench.connection.counters.messages_in == before + 2, "taken both")
        sent = 0
        batch: messages.Batch | None = None
        while batch is None or not batch.last:
            received = link.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            batch = received.message
            sent += batch.parts[0].packet_count
        probed = bench.hears(messages.VoxelProbed)
        mapped = bench.hears(messages.FrameMapped)
    assert isinstance(probed, messages.VoxelProbed) and isinstance(mapped, messages.FrameMapped)
    voxel = probed.voxel
    assert voxel is not None and voxel.index[2] == side - 1 and voxel.density == 200.0
    assert sent == mapped.stats.packets == side**3


def test_a_probe_of_another_assignment_is_refused_by_its_number(bench: Bench, shells: Path) -> None:
    geometry = bench.holds(shells, 1)
    refused = bench.refuses(probe(geometry, SCENE, assignment=2))
    assert (refused.question, refused.frame) == (1, 0) and "question 1 is for assignment 2, not 1" in refused.cause
    bench.control.send(probe(geometry, SCENE))
    assert bench.hears(messages.VoxelProbed)


@pytest.mark.parametrize("unread", ["batches", "answers"])
def test_a_server_ends_though_nobody_reads_what_it_sends(bench: Bench, tmp_path: Path, unread: str) -> None:
    """Batches to the splat server, or parts of a lent volume to the client, more than the sockets hold."""
    side = 160
    volume = tmp_path / "full.mha"
    write_volume(volume, torch.full((side,) * 3, 200, dtype=torch.uint8), Geometry((side,) * 3))
    geometry = bench.holds(volume, 1)
    bench.connects(0)
    with bench.accepts(0) as link:
        sent = bench.connection.counters.bytes_out
        if unread == "batches":
            bench.control.send(render(1, geometry, plain_scene(view=View(zoom=1.0), size=(320, 320))))
            wait_until(lambda: link._socket.recv(1, socket.MSG_PEEK), "sent a byte")
        else:
            bench.control.send(messages.LendVolume(2, str(volume), identified_volume(str(volume))[1]))
            bench.hears(messages.VolumeLent)
            for n in range(3):
                bench.control.send(messages.ReadPart(2, messages.VolumePart(n + 1, 0, 0, "uint8", geometry.box)))
            wait_until(lambda: bench.connection.counters.bytes_out > sent + (1 << 16), "begun to send")
        bench.control.send(messages.EndSession())
        bench.ends()
        assert bench.failure is None
    bench.control.close()


def test_only_the_newest_of_the_frames_that_wait_is_kept(bench: Bench, tmp_path: Path) -> None:
    """A client asks for frames while the server is at one that nobody reads."""
    side = 160
    volume = tmp_path / "full.mha"
    write_volume(volume, torch.full((side,) * 3, 200, dtype=torch.uint8), Geometry((side,) * 3))
    geometry = bench.holds(volume, 1)
    bench.connects(0)
    with bench.accepts(0) as link:
        bench.control.send(render(1, geometry, plain_scene(view=View(zoom=1.0), size=(320, 320))))
        wait_until(lambda: link._socket.recv(1, socket.MSG_PEEK), "sent a byte")
        before = bench.connection.counters.messages_in
        for frame in range(2, 202):
            bench.control.send(render(frame, geometry))
        wait_until(lambda: bench.connection.counters.messages_in == before + 200, "taken all")
        assert len(bench.waiting) <= 1
        bench.control.send(messages.EndSession())
        bench.ends()
    bench.control.close()


def test_a_server_ends_where_the_memory_does_not_suffice_for_a_part() -> None:
    def no_memory(message: messages.Message, nbytes: int) -> bytearray:
        raise MemoryError

    bench = Bench(no_memory)
    part, payload = SAMPLES[messages.HoldPart]
    bench.control.send(part, payload)
    with pytest.raises(PeerLost):
        bench.control.receive()
    bench.control.close()
    bench.close()
    assert "the memory does not suffice" in str(bench.failure)


def test_a_server_ends_though_the_splat_server_cannot_be_reached(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be dialled for ever."""
    monkeypatch.setattr("volsplat.mapshade_server.links.splat_links.connect", partial(connect, patience=math.inf))
    nobody = bench.splat_servers[0].address
    bench.splat_servers[0].close()
    before = bench.connection.counters.messages_in
    bench.control.send(messages.ConnectToSplatServers([messages.Route(2, nobody.host, nobody.port, KEY)]))
    wait_until(lambda: bench.connection.counters.messages_in > before, "taken it")
    bench.control.send(messages.EndSession())
    bench.ends()
    bench.control.close()


def test_what_waits_is_not_begun_once_the_session_is_over(shells: Path) -> None:
    """The wrong volume may take minutes to read, and nobody waits for it."""
    requests = WaitingRequests()
    requests.put(Received(messages.DescribeVolume(str(shells)), memoryview(b"")))
    requests.end()
    assert requests.get() is None


def test_a_volume_is_read_no_further_once_its_client_is_gone(shells: Path) -> None:
    held = HeldVolume()
    (described,) = held.answers(messages.DescribeVolume(str(shells)))
    assert isinstance(described.message, messages.VolumeDescribed)
    box, identity = described.message.description.geometry.box, described.message.identity
    held.superseded = lambda assignment: True
    assert held.answers(messages.ReadSubCubes(1, str(shells), [box], identity)) == []
    assert held.answers(messages.LendVolume(2, str(shells), identity)) == []
    assert held.answers(messages.ChangeSubCubes(3, str(shells), [box], identity, QUANTISATION)) == []
    with pytest.raises(GivenUp):
        held.reading_ahead(messages.ReadAhead(1, str(shells), [box], identity, QUANTISATION))()
    assert held.packed_bytes == 0
