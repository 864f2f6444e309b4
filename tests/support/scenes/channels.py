"""Both ends of channels in one process, and frames that are splatted from what comes through."""

import mmap
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from torch import Tensor

from support.patience import wait_until
from support.scenes.owned import owners
from support.scenes.rendering import batch_memory
from support.scenes.shaded_packets import batches_of
from support.scenes.shadings import WINDOW
from volsplat.mapshade_server._kernels import BatchChannel, ChannelMemory
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.regions import Region
from volsplat.protocol.wire.shared_memory import sealed_memory
from volsplat.splat_server._kernels import BatchTaker, Bell, ReadBudget
from volsplat.splat_server.frame_assembly import FrameAssembly

PLAIN = Quantisation(window=WINDOW, strength_scale=50.0)
WALKERS, BLOCKS, BLOCK_BYTES = 3, 2, 1 << 12
LINE = 64  # bytes: of each bell, and of what stands before a block
NOTE = struct.Struct("<I4xqQQQQ")  # state, frame, (sheet, row) reached, regions, whether it is the last


@dataclass
class Channels:
    """Both ends in one process, as two would map them."""

    memory: mmap.mmap
    ways: list[BatchChannel]
    taker: BatchTaker
    news: Bell

    def note(self, walker: int, block: int, *note: int) -> None:
        """Say by hand what a block holds."""
        NOTE.pack_into(self.memory, LINE * (1 + len(self.ways) + walker * BLOCKS + block), *note)
        channel = struct.Struct("<I")
        channel.pack_into(self.memory, 0, channel.unpack_from(self.memory)[0] + 1)

    @property
    def tile_news(self) -> int:
        """Where the news of closed tiles begin: changes, frame, first word, count of words, and these, 8 bytes each."""
        return LINE * (1 + len(self.ways) * (1 + BLOCKS))

    def scribble(self, place: int, what: bytes) -> None:
        """Anywhere but over the news of closed tiles, which the taker only writes."""
        heads, blocks = self.tile_news, len(self.ways) * BLOCKS * BLOCK_BYTES
        begin = place % (heads + blocks - len(what))
        begin += len(self.memory) - heads - blocks if begin >= heads else 0
        self.memory[begin : begin + len(what)] = what

    def write(self, walker: int, block: int, what: bytes) -> None:
        """Into a block."""
        begin = len(self.memory) - (len(self.ways) * BLOCKS - walker * BLOCKS - block) * BLOCK_BYTES
        self.memory[begin : begin + len(what)] = what


@contextmanager
def channels(walkers: int = WALKERS, block_bytes: int = BLOCK_BYTES) -> Iterator[Channels]:
    shape = walkers, BLOCKS, block_bytes
    size = ChannelMemory.bytes(*shape)
    assert size == BatchTaker.memory_bytes(*shape)
    descriptor, news = sealed_memory(size), Bell()
    try:
        filled, seen = ChannelMemory(descriptor, *shape), mmap.mmap(descriptor, size)
        taker = BatchTaker(descriptor, *shape, news=news)
    finally:
        os.close(descriptor)
    try:
        yield Channels(seen, [BatchChannel(filled, walker) for walker in range(walkers)], taker, news)
    finally:
        taker.close()


def walk_of(
    held: SubCube,
    scene: Scene,
    plan: FramePlan,
    regions: list[Region],
    walkers: int = WALKERS,
    closed_tiles: memoryview | None = None,
) -> FrameWalk:
    return FrameWalk([held], Drawing.of(scene, plan, held.geometry, PLAIN), closed_tiles, regions, walkers)


def held_of(geometry: Geometry, values: Tensor) -> SubCube:
    held = SubCube.of_volume(geometry, values)
    held.pack(PLAIN)
    return held


@contextmanager
def begun(plan: FramePlan, regions: list[Region], frame: int = 1, sources: int = WALKERS) -> Iterator[FrameAssembly]:
    with owners(2) as made:
        assembly = FrameAssembly(made, plan, frame)
        assembly.begin(regions, sources, Bell())
        yield assembly


def finished(assembly: FrameAssembly) -> bytes:
    wait_until(lambda: assembly.splat.complete, "a finished frame")
    return bytes(assembly.published())


def pushed(walk: FrameWalk, plan: FramePlan, regions: list[Region], most: int) -> bytes:
    """The image without channels."""
    budget = ReadBudget(1 << 62, Bell())
    with begun(plan, regions) as assembly:
        for source, walker in enumerate(walk.walkers):
            for batch in batches_of(walker, most):
                assembly.splat.push(source, batch_memory(parts_of(batch), budget), *batch.reached, batch.last)
        return finished(assembly)
