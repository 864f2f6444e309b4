"""A frame's walkers, each in a thread of its own: the same image whatever way batches go, and an end to it."""

import struct
import threading
from collections.abc import Callable
from contextlib import ExitStack

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from support.patience import PATIENCE, wait_until
from support.scenes.arbitrary import geometries, plain_scene
from support.scenes.channels import WALKERS, begun, channels, finished, held_of, pushed, walk_of
from support.scenes.rendering import batch_memory
from support.scenes.shadings import shaded_scenes, volumes
from volsplat.mapshade_server._kernels import Batch, ChannelOutlet, Crew, Delivery, NewestFrame, StillWanted
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.links.channels import BLOCK_BYTES
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Order, Scene, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.closed_tiles import TILE_SIDE, new_tile_map, tile_map_bytes
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.rules.regions import Region
from volsplat.splat_server._kernels import Bell, ReadBudget, SplatFrame

LONGEST_ROW = 1 << 16  # see kLongestRow
UNBOUNDED = ReadBudget(1 << 62, Bell())


class Pushing:
    """Pushes what is for some regions, as a link by sockets would."""

    def __init__(self, splat: SplatFrame, source: int, parts: slice, most: int) -> None:
        self._splat = splat
        self._source = source
        self._parts = parts
        self._most = most

    def most_packets(self) -> float:
        return self._most

    def send(self, batch: Batch) -> bool:
        memory = batch_memory(parts_of(batch)[self._parts], UNBOUNDED)
        self._splat.push(self._source, memory, *batch.reached, batch.last)
        return True


class Deaf:
    """Takes all batches, and does what it is told."""

    def __init__(self, answer: Callable[[], bool] = lambda: True) -> None:
        self.batches = 0
        self._answer = answer

    def most_packets(self) -> float:
        return 50.0

    def send(self, _: Batch) -> bool:
        self.batches += 1
        return self._answer()


Outlets = list[list[ChannelOutlet | Deaf | None]]  # of each walker, for each splat server


def wanted(frame: int = 1) -> StillWanted:
    return StillWanted(NewestFrame(), frame)


def no_failure() -> None:
    raise AssertionError("a walker has failed")


def frame_of(scene: Scene, geometry: Geometry, step: Step = Step.F) -> FramePlan:
    return msgspec.structs.replace(plan_frame(scene, geometry, step), edges=())


@given(data=st.data(), geometry=geometries(largest=24), step=st.sampled_from(PAPER_STEPS))
def test_images_are_the_same_by_channels_and_by_sockets(data: st.DataObject, geometry: Geometry, step: Step) -> None:
    """Two splat servers, each reached either way; what one of them has closed by then is left out."""
    size = Image(width=data.draw(st.integers(1, 90)), height=data.draw(st.integers(1, 90)))
    scene = data.draw(shaded_scenes(geometry, size))
    plan = frame_of(scene, geometry, step)
    cut = TILE_SIDE * data.draw(st.integers(0, plan.height // TILE_SIDE))
    regions = [Region(1, 0, cut), Region(2, cut, plan.height)]
    held = held_of(geometry, data.draw(volumes(geometry)))

    def drawn(by_socket: set[int], most: int, block_bytes: int) -> list[bytes]:
        tiles = new_tile_map(plan.width, plan.height) if plan.hides else None
        walk, of_frame = walk_of(held, scene, plan, regions, closed_tiles=tiles), wanted()
        with ExitStack() as stack:
            frames = [stack.enter_context(begun(plan, [region])) for region in regions]
            ways = [stack.enter_context(channels(block_bytes=block_bytes)) for _ in regions]
            for way, frame in zip(ways, frames, strict=True):
                way.taker.begin(1, frame.splat, 0, WALKERS, False)
            outlets = [
                [
                    Pushing(frames[n].splat, walker, slice(n, n + 1), most)
                    if n in by_socket
                    else ChannelOutlet(ways[n].ways[walker], 1, n, n + 1, tiles, of_frame)
                    for n in range(2)
                ]
                for walker in range(WALKERS)
            ]
            delivery = Delivery(walk.walkers, outlets, of_frame)
            delivery.run(Crew(), no_failure)
            images = [finished(frame) for frame in frames]
            assert not delivery.lost(0) and not delivery.lost(1)
            assert all(way.taker.fault == "" for way in ways)
            return images

    by_socket, most = data.draw(st.sets(st.sampled_from((0, 1)))), data.draw(st.sampled_from((10, 300, 100000)))
    assert drawn(by_socket, most, data.draw(st.sampled_from((512, 1 << 16)))) == drawn({0, 1}, 1 << 15, 512)


def opaque_cube() -> tuple[Scene, Geometry, torch.Tensor]:
    geometry = Geometry((40, 40, 40))
    scene = plain_scene(opacity=1.0, size=(64, 64))
    return msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK), geometry, torch.full((40, 40, 40), 200.0)


def test_what_is_hidden_by_then_is_not_sent() -> None:
    """With hardly any room in the channel, a walker cannot run ahead of what closes tiles."""
    scene, geometry, values = opaque_cube()
    plan = frame_of(scene, geometry)
    regions, held = [Region(1, 0, plan.height)], held_of(geometry, values)
    sent = {}
    for tiles in (None, new_tile_map(plan.width, plan.height)):
        walk, of_frame = walk_of(held, scene, plan, regions, closed_tiles=tiles), wanted()
        with begun(plan, regions) as assembly, channels(block_bytes=1 << 14) as through:
            through.taker.begin(1, assembly.splat, 0, WALKERS, False)
            outlets = [[ChannelOutlet(way, 1, 0, 1, tiles, of_frame)] for way in through.ways]
            delivery = Delivery(walk.walkers, outlets, of_frame)
            delivery.run(Crew(), no_failure)
            image = finished(assembly)
            sent[tiles is None] = sum(delivery.tally(walker).packets for walker in range(WALKERS))
        assert image == pushed(walk_of(held, scene, plan, regions), plan, regions, 1 << 15)
    assert sent[False] < sent[True] == 40**3


def test_news_of_another_frame_are_not_heard() -> None:
    scene, geometry, values = opaque_cube()
    plan = frame_of(scene, geometry)
    regions, held = [Region(1, 0, plan.height)], held_of(geometry, values)
    with begun(plan, regions) as assembly, channels(block_bytes=1 << 20) as through:
        through.taker.begin(1, assembly.splat, 0, WALKERS, False)

        def heard(frame: int) -> bool:
            """Whether a frame's walkers hear of closed tiles before they send."""
            tiles, of_frame = new_tile_map(plan.width, plan.height), wanted(frame)

            def end() -> bool:
                of_frame.end()
                return True

            outlets: Outlets = [[ChannelOutlet(way, frame, 0, 1, tiles, of_frame), Deaf(end)] for way in through.ways]
            Delivery(walk_of(held, scene, plan, regions).walkers, outlets, of_frame).run(Crew(), no_failure)
            return any(tiles.cast("B"))

        of_frame = wanted()
        drawn = [[ChannelOutlet(way, 1, 0, 1, None, of_frame)] for way in through.ways]
        Delivery(walk_of(held, scene, plan, regions).walkers, drawn, of_frame).run(Crew(), no_failure)
        finished(assembly)
        assert not heard(2) and heard(1)


def test_a_channel_holds_the_longest_run() -> None:
    """Of a row of which as much lies within 256 pixels as can at the least zoom of equal spacings."""
    geometry = Geometry((LONGEST_ROW, 1, 1))
    scene = plain_scene(opacity=0.01, size=(LONGEST_ROW // 64 + 40, 8), view=View(zoom=1 / 64))
    plan = frame_of(scene, geometry)
    regions, of_frame = [Region(1, 0, plan.height)], wanted()
    held = held_of(geometry, torch.full((1, 1, LONGEST_ROW), 200.0))
    with begun(plan, regions) as assembly, channels(block_bytes=BLOCK_BYTES) as through:
        through.taker.begin(1, assembly.splat, 0, WALKERS, False)
        outlets = [[ChannelOutlet(way, 1, 0, 1, None, of_frame)] for way in through.ways]
        delivery = Delivery(walk_of(held, scene, plan, regions).walkers, outlets, of_frame)
        delivery.run(Crew(), no_failure)
        assert finished(assembly) == pushed(walk_of(held, scene, plan, regions), plan, regions, 1 << 17)
        assert sum(delivery.tally(walker).packets for walker in range(WALKERS)) == LONGEST_ROW


def test_no_more_words_are_told_than_the_map_has_whatever_the_memory_says() -> None:
    """Else a splat server would read beyond its map for a map/shade server that is broken or hostile."""
    scene, geometry, values = opaque_cube()
    plan = frame_of(scene, geometry)
    regions, held, of_frame = [Region(1, 0, plan.height)], held_of(geometry, values), wanted()
    with begun(plan, regions) as assembly, channels(block_bytes=1 << 14) as through:
        through.taker.begin(1, assembly.splat, 0, WALKERS, False)
        begin, count = through.tile_news, tile_map_bytes(plan.width, plan.height) // 8
        struct.pack_into("<Q", through.memory, begin + 24, 1 << 18)
        outlets = [[ChannelOutlet(way, 1, 0, 1, None, of_frame)] for way in through.ways]
        Delivery(walk_of(held, scene, plan, regions).walkers, outlets, of_frame).run(Crew(), no_failure)
        finished(assembly)
        words = memoryview(through.memory)[begin + 32 :][: 8 << 18].cast("Q")
        assert any(words[:count]) and not any(words[count:])
        words.release()


@pytest.fixture
def walk() -> FrameWalk:
    """Of some batches for each walker."""
    scene, geometry, values = opaque_cube()
    plan = frame_of(scene, geometry)
    return walk_of(held_of(geometry, values), scene, plan, [Region(1, 0, plan.height)])


def running(delivery: Delivery) -> threading.Thread:
    thread = threading.Thread(target=delivery.run, args=(Crew(), no_failure))
    thread.start()
    return thread


def test_whoever_waits_for_room_ends_with_a_newer_frame(walk: FrameWalk) -> None:
    newest = NewestFrame()
    of_frame = StillWanted(newest, 1)
    with channels() as through:  # whose taker waits for frame 1
        delivery = Delivery(
            walk.walkers, [[ChannelOutlet(way, 1, 0, 1, None, of_frame)] for way in through.ways], of_frame
        )
        thread = running(delivery)
        wait_until(lambda: through.taker.newest_frame == 1, "a batch in the channel")
        assert thread.is_alive()
        newest.number = 2
        thread.join(PATIENCE)
        assert not thread.is_alive() and not of_frame() and not delivery.lost(0)


def test_a_splat_server_that_is_lost_gets_no_more_and_the_others_get_all(walk: FrameWalk) -> None:
    of_frame, others = wanted(), [Deaf() for _ in walk.walkers]
    with channels() as through:
        outlets: Outlets = [
            [ChannelOutlet(way, 1, 0, 1, None, of_frame), other]
            for way, other in zip(through.ways, others, strict=True)
        ]
        delivery = Delivery(walk.walkers, outlets, of_frame)
        thread = running(delivery)
        wait_until(lambda: through.taker.newest_frame == 1, "a batch in the channel")
        for way in through.ways:
            way.close()
        thread.join(PATIENCE)
        assert not thread.is_alive() and delivery.lost(0) and not delivery.lost(1)
    assert [other.batches for other in others] == [delivery.tally(n).batches for n in range(WALKERS)]
    assert sum(delivery.tally(n).packets for n in range(WALKERS)) == 40**3


def test_a_frame_that_nobody_gets_is_over(walk: FrameWalk) -> None:
    outlets = [[Deaf(lambda: False)] for _ in walk.walkers]
    delivery = Delivery(walk.walkers, outlets, wanted())
    delivery.run(Crew(), no_failure)
    assert delivery.lost(0) and 1 <= sum(one.batches for (one,) in outlets) <= WALKERS


def test_nothing_is_sent_to_who_was_lost_before(walk: FrameWalk) -> None:
    others = [Deaf() for _ in walk.walkers]
    delivery = Delivery(walk.walkers, [[None, other] for other in others], wanted())
    delivery.run(Crew(), no_failure)
    assert delivery.lost(0) and not delivery.lost(1)
    assert sum(delivery.tally(n).packets for n in range(WALKERS)) == 40**3


def test_what_an_outlet_raises_ends_all_walkers(walk: FrameWalk) -> None:
    def fail() -> bool:
        raise OSError("no way out")

    with channels() as through:  # in which the others find no room
        of_frame = wanted()
        outlets: Outlets = [[ChannelOutlet(way, 1, 0, 1, None, of_frame), Deaf()] for way in through.ways]
        outlets[1] = [Deaf(), Deaf(fail)]
        delivery = Delivery(walk.walkers, outlets, of_frame)
        delivery.run(Crew(), lambda: None)
        assert delivery.failed and not of_frame()
        with pytest.raises(OSError, match="no way out"):
            delivery.check()


def test_a_failure_is_told_while_another_walker_still_sends(walk: FrameWalk) -> None:
    """To a splat server, perhaps, that reads no more until it hears from the walker that has failed."""
    told, ended = threading.Event(), threading.Event()

    def fail() -> bool:
        raise OSError("no way out")

    def send() -> bool:
        assert ended.wait(PATIENCE)
        return True

    outlets: Outlets = [[Deaf(send)], [Deaf(fail)], [Deaf(send)]]
    delivery = Delivery(walk.walkers, outlets, wanted())
    thread = threading.Thread(target=delivery.run, args=(Crew(), told.set))
    thread.start()
    try:
        assert told.wait(PATIENCE) and delivery.failed and thread.is_alive()
        with pytest.raises(OSError, match="no way out"):
            delivery.check()
    finally:
        ended.set()
        thread.join(PATIENCE)
    assert not thread.is_alive()


def test_walkers_have_outlets_alike(walk: FrameWalk) -> None:
    with pytest.raises(ValueError, match="an outlet for each splat server"):
        Delivery(walk.walkers, [[Deaf()], [Deaf()], []], wanted())
    with pytest.raises(ValueError, match="outlets"):
        Delivery(walk.walkers, [[Deaf()]], wanted())


def test_a_crew_walks_frames_of_any_number_of_walkers() -> None:
    scene, geometry, values = opaque_cube()
    plan = frame_of(scene, geometry)
    held, regions, crew = held_of(geometry, values), [Region(1, 0, plan.height)], Crew()
    for walkers in (1, 5, 2, 1, 8):
        walk = walk_of(held, scene, plan, regions, walkers)
        delivery = Delivery(walk.walkers, [[Deaf()] for _ in range(walkers)], wanted())
        delivery.run(crew, no_failure)
        assert sum(delivery.tally(n).packets for n in range(walkers)) == 40**3
