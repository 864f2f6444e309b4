"""Batches through memory that walkers and splat server share: the same image, however small it is."""

import os
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from support.patience import PATIENCE, wait_until
from support.scenes.arbitrary import geometries, plain_scene
from support.scenes.channels import (
    BLOCK_BYTES,
    BLOCKS,
    WALKERS,
    Channels,
    begun,
    channels,
    finished,
    held_of,
    pushed,
    walk_of,
)
from support.scenes.shaded_packets import batches_of
from support.scenes.shadings import shaded_scenes, volumes
from volsplat.mapshade_server._kernels import Batch, BatchChannel
from volsplat.mapshade_server.frames.frame_walk import DEFAULT_PACKETS, DEFAULT_VOXELS, FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.channels import shared_channels
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.shared_memory import sealed_memory
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server._kernels import BatchTaker, Bell, SplatFrame
from volsplat.splat_server.came_batches import Came

FILLED = 1


def sent(through: Channels, walk: FrameWalk, frame: int, first: int, end: int, most: int) -> list[threading.Thread]:
    """Have every walker send these regions' parts in a thread of its own."""

    def send(channel: BatchChannel, number: int) -> None:
        for batch in batches_of(walk.walkers[number], most):
            channel.begin(frame, batch, first, end)
            while not channel.send(PATIENCE):
                pass

    threads = [threading.Thread(target=send, args=(channel, number)) for number, channel in enumerate(through.ways)]
    for thread in threads:
        thread.start()
    return threads


def nbytes(batch: Batch) -> int:
    return sum(len(part.runs) + len(part.packets) for part in parts_of(batch))


def joined(threads: list[threading.Thread]) -> None:
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()


@given(data=st.data(), geometry=geometries(largest=24), step=st.sampled_from(PAPER_STEPS))
def test_images_are_the_same_through_channels_however_small_their_blocks(
    data: st.DataObject, geometry: Geometry, step: Step
) -> None:
    size = Image(width=data.draw(st.integers(1, 90)), height=data.draw(st.integers(1, 90)))
    scene = data.draw(shaded_scenes(geometry, size))
    plan = msgspec.structs.replace(plan_frame(scene, geometry, step), edges=())
    cuts = sorted(data.draw(st.lists(st.integers(0, plan.height // TILE_SIDE), max_size=4)))
    edges = [0, *(cut * TILE_SIDE for cut in cuts), plan.height]
    regions = [Region(1, begin, end) for begin, end in zip(edges, edges[1:], strict=False)]
    held, most = held_of(geometry, data.draw(volumes(geometry))), data.draw(st.sampled_from((10, 300, 100000)))
    expected = pushed(walk_of(held, scene, plan, regions), plan, regions, most)
    with channels(block_bytes=data.draw(st.sampled_from((512, 4096, 1 << 20)))) as through:
        for frame in (1, 2):  # the memory is used again
            with begun(plan, regions, frame) as assembly:
                through.taker.begin(frame, assembly.splat, 0, WALKERS, False)
                sending = sent(through, walk_of(held, scene, plan, regions), frame, 0, len(regions), most)
                image = finished(assembly)
                joined(sending)
                assert through.taker.fault == "" and image == expected
                through.taker.begin(frame, None, 0, 0, False)


@dataclass
class Subject:
    """A frame of one region that shows something."""

    held: SubCube
    scene: Scene
    plan: FramePlan
    regions: list[Region]

    @property
    def walk(self) -> FrameWalk:
        return walk_of(self.held, self.scene, self.plan, self.regions)

    @contextmanager
    def frame(self, number: int = 1) -> Iterator[SplatFrame]:
        with begun(self.plan, self.regions, number) as assembly:
            yield assembly.splat


@pytest.fixture(scope="module")
def subject() -> Subject:
    geometry = Geometry((12, 12, 12))
    scene = plain_scene(opacity=0.5, size=(32, 32))
    plan = msgspec.structs.replace(plan_frame(scene, geometry, Step.F), edges=())
    values = torch.linspace(0, 255, 12**3).reshape(12, 12, 12)
    return Subject(held_of(geometry, values), scene, plan, [Region(1, 0, plan.height)])


def test_a_walker_that_finds_no_room_waits_until_there_is_some(subject: Subject) -> None:
    with channels() as through:
        channel, walker = through.ways[0], subject.walk.walkers[0]
        for _ in range(BLOCKS):
            batch = walker.next_batch(1, DEFAULT_VOXELS)
            channel.begin(1, batch, 0, 1)
            assert channel.send(0.0)
        batch = walker.next_batch(1, DEFAULT_VOXELS)
        channel.begin(1, batch, 0, 1)
        assert not channel.send(0.0) and not channel.send(0.01)
        through.taker.begin(1, None, 0, 0, False)  # nobody wants them
        assert channel.send(PATIENCE)


def test_batches_of_a_later_frame_wait_for_it_and_those_of_an_older_one_go(subject: Subject) -> None:
    with channels() as through:
        heard = through.news.rung
        older = subject.walk.walkers[0].next_batch(1, DEFAULT_VOXELS)
        through.ways[0].begin(1, older, 0, 1)
        assert through.ways[0].send(0.0)
        wait_until(through.taker.take_news, "news of the first frame")
        sending = sent(through, subject.walk, 2, 0, 1, 100)
        through.taker.begin(1, None, 0, 0, False)
        wait_until(through.taker.take_news, "news of the later frame")
        assert not through.taker.take_news() and through.taker.bytes == 0
        assert through.news.rung == heard, "nobody waits for the later frame before it begins"
        with subject.frame(2) as frame:
            through.taker.begin(2, frame, 0, WALKERS, True)
            wait_until(lambda: frame.complete, "a finished frame")
            assert through.taker.fault == "" and through.taker.bytes > 0
            assert {walker for walker, _, _ in through.taker.spans} == set(range(WALKERS))
            assert all(began >= ended >= 0.0 for _, began, ended in through.taker.spans)
            through.taker.begin(2, None, 0, 0, False)
        joined(sending)


def test_who_waits_for_a_frame_hears_of_batches_of_a_later_one(subject: Subject) -> None:
    with channels() as through, subject.frame(1) as frame:
        heard = through.news.rung
        through.taker.begin(1, frame, 0, WALKERS, False)
        assert not through.taker.take_news()
        sending = sent(through, subject.walk, 2, 0, 1, 100)
        wait_until(lambda: through.news.rung > heard, "news of the later frame")
        assert through.taker.take_news() and through.taker.newest_frame == 2
        through.taker.begin(1, None, 0, 0, False)
        assert through.taker.take_news(), "it is still later than what is begun"
        through.taker.begin(2, None, 0, 0, False)
        joined(sending)


def test_a_batch_that_was_given_up_half_way_is_forgotten_with_its_frame(subject: Subject) -> None:
    with channels(block_bytes=512) as through:
        batch = subject.walk.walkers[0].next_batch(DEFAULT_PACKETS, DEFAULT_VOXELS)
        assert nbytes(batch) > BLOCKS * 512
        through.ways[0].begin(1, batch, 0, 1)
        assert not through.ways[0].send(0.0)  # blocks of it are there
        with subject.frame(2) as frame:
            through.taker.begin(2, frame, 0, WALKERS, False)
            joined(sent(through, subject.walk, 2, 0, 1, 100))
            wait_until(lambda: frame.complete, "a finished frame")
            assert through.taker.fault == ""


def test_what_is_there_can_be_taken_at_once(subject: Subject) -> None:
    """As where a link ends."""
    with channels() as through, subject.frame() as frame:
        through.taker.begin(1, frame, 0, WALKERS, False)
        batch = subject.walk.walkers[0].next_batch(1, DEFAULT_VOXELS)
        through.ways[0].begin(1, batch, 0, 1)
        assert through.ways[0].send(0.0)
        through.taker.drain()
        assert through.taker.bytes == nbytes(batch)
        through.taker.close()
        through.taker.close()


def test_a_block_that_is_filled_again_before_it_was_free_is_a_fault(subject: Subject) -> None:
    """Else what waits for other walkers would grow without end."""
    with channels() as through, subject.frame() as frame:
        through.taker.begin(1, frame, 0, WALKERS, False)
        for batch in (subject.walk.walkers[0].next_batch(1, DEFAULT_VOXELS) for _ in range(BLOCKS)):
            through.ways[0].begin(1, batch, 0, 1)
            assert through.ways[0].send(PATIENCE)
        wait_until(lambda: through.taker.bytes > 0 or through.taker.fault != "", "a batch that is taken")
        for block in range(BLOCKS):
            through.note(0, block, FILLED, 1, 0, 0, 1, 0)
        wait_until(lambda: through.taker.fault != "", "a fault")


def test_whatever_another_walker_has_still_sent_of_a_frame_that_is_given_up_is_no_fault(subject: Subject) -> None:
    with channels() as through, subject.frame() as frame:
        later = subject.walk.walkers[0].next_batch(1, DEFAULT_VOXELS)
        through.ways[0].begin(2, later, 0, 1)
        assert through.ways[0].send(0.0)
        wait_until(lambda: through.taker.newest_frame == 2, "news of the later frame")
        through.taker.begin(1, frame, 0, WALKERS, False)
        through.taker.begin(1, None, 0, 0, False)
        for source in range(WALKERS):
            frame.finish(source)
        older = subject.walk.walkers[1].next_batch(1, DEFAULT_VOXELS)
        through.ways[1].begin(1, older, 0, 1)
        assert through.ways[1].send(0.0)
        wait_until(lambda: frame.complete, "a finished frame")
        through.taker.drain()
        assert through.taker.fault == ""


@pytest.mark.parametrize(
    ("regions", "counts", "fault"),
    [
        (1 << 40, b"", "parts, more than a block holds"),
        (2, bytes(32), "has 2 parts, but there are 1 regions"),
        (1, struct.pack("<2Q", 1 << 60, 1), "longer than its"),
        (1, struct.pack("<2Q", 0, 1 << 60), "longer than its"),
        (1, struct.pack("<2Q6I", 1, 1, 0, 0, 0, 1 << 31, 0, 0), "leaves the frame's"),
        (1, struct.pack("<2Q6I", 1, 2, 0, 0, 0, 1, 0, 0), "the runs hold 1 packets, the batch 2"),
    ],
    ids=["regions", "too many parts", "runs", "packets", "a run outside", "a packet in no run"],
)
def test_a_batch_that_breaks_the_rules_is_not_taken(subject: Subject, regions: int, counts: bytes, fault: str) -> None:
    with channels() as through, subject.frame() as frame:
        through.taker.begin(1, frame, 0, WALKERS, False)
        heard = through.news.rung
        through.write(1, 0, counts)
        through.note(1, 0, FILLED, 1, 0, 0, regions, 0)
        wait_until(lambda: through.taker.fault != "", "a fault")
        assert fault in through.taker.fault and through.taker.fault.startswith("frame 1: ")
        assert through.news.rung > heard and frame.packets == 0


@pytest.mark.parametrize(("walkers", "fault"), [(0, "it has no part"), (1, "walker 1 has no part")])
def test_who_has_no_part_in_a_frame_may_send_none_of_it(subject: Subject, walkers: int, fault: str) -> None:
    with channels() as through, subject.frame() as frame:
        through.taker.begin(1, frame, 0, walkers, False)
        through.note(1, 0, FILLED, 1, 0, 0, 1, 0)
        wait_until(lambda: fault in through.taker.fault, "a fault")


@given(scribbles=st.lists(st.tuples(st.integers(0, 1 << 20), st.binary(min_size=1, max_size=80)), max_size=40))
def test_whoever_scribbles_in_the_memory_spoils_no_more_than_its_own_batches(
    subject: Subject, scribbles: list[tuple[int, bytes]]
) -> None:
    """The taker goes on, or has found a fault, and ends when it is to."""
    with channels() as through, subject.frame() as frame:
        through.taker.begin(1, frame, 0, WALKERS, False)
        batches = batches_of(subject.walk.walkers[0], 50)
        for place, what in scribbles:
            if (batch := next(batches, None)) is not None:
                through.ways[0].begin(1, batch, 0, 1)
                through.ways[0].send(0.0)
            through.scribble(place, what)
        through.taker.drain()
        through.taker.close()


def sealed(size: int, seal: bool = True) -> int:
    if seal:
        return sealed_memory(size)
    descriptor = os.memfd_create("test", os.MFD_ALLOW_SEALING)
    os.ftruncate(descriptor, size)
    return descriptor


@pytest.mark.parametrize(("more", "seal", "fault"), [(0, False, "not sealed"), (1, True, "are announced")])
def test_memory_that_could_vanish_or_is_too_small_is_refused(more: int, seal: bool, fault: str) -> None:
    came, message = Came(), messages.ChannelsShared(WALKERS, BLOCKS, BLOCK_BYTES)
    size = BatchTaker.memory_bytes(WALKERS, BLOCKS, BLOCK_BYTES)
    with pytest.raises(RemoteProtocolError, match=fault):
        came.share(message, sealed(size + more, seal), Bell())


def test_channels_are_shared_once_and_leave_no_descriptor_open() -> None:
    before = set(os.listdir("/proc/self/fd"))
    came, message = Came(), messages.ChannelsShared(WALKERS, BLOCKS, BLOCK_BYTES)
    size = BatchTaker.memory_bytes(WALKERS, BLOCKS, BLOCK_BYTES)
    came.share(message, sealed(size), Bell())
    with pytest.raises(RemoteProtocolError, match="for the second time"):
        came.share(message, sealed(size), Bell())
    came.let_go()
    assert set(os.listdir("/proc/self/fd")) <= before


def test_memory_that_is_shared_leaves_no_descriptor_open() -> None:
    with data_link() as link:
        before = set(os.listdir("/proc/self/fd"))
        through = shared_channels(link, WALKERS)
        assert len(through) == WALKERS and set(os.listdir("/proc/self/fd")) <= before


@contextmanager
def data_link() -> Iterator[Connection]:
    """A worker's, which may share memory; what it sends is not taken."""
    token = new_token()
    with Listener(Role.SPLAT_SERVER, token) as listener:
        with connect(listener.address, new_hello(Role.DATA_LINK, server=4), token, Role.SPLAT_SERVER, server=1) as link:
            taken = listener.accept(PATIENCE)
            assert taken is not None
            with taken:
                yield link


def test_a_block_that_does_not_hold_a_run_is_too_small(subject: Subject) -> None:
    with channels(block_bytes=64) as through:
        batch = subject.walk.walkers[0].next_batch(DEFAULT_PACKETS, DEFAULT_VOXELS)
        through.ways[0].begin(1, batch, 0, 1)
        with pytest.raises(ValueError, match="longest run"):
            through.ways[0].send(0.0)
