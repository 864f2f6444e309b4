"""The second pass: packs one level block by block, and lays down the means that the next level is packed from."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.packet_store import BRICK_FIELDS, Packets
from volsplat.mapshade_server.prepare.ahead import ahead
from volsplat.mapshade_server.prepare.brick_extents import brick_extents
from volsplat.mapshade_server.prepare.halving import halved, halved_second
from volsplat.mapshade_server.prepare.journal import Journal
from volsplat.mapshade_server.prepare.layout import Layout, halved_box
from volsplat.mapshade_server.prepare.level_source import LevelSource
from volsplat.mapshade_server.prepare.scalars import BlockScalars, Scalars, StoredScalars
from volsplat.mapshade_server.prepare.store_writer import StoreWriter
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.description.volume import HALO, Box, Geometry
from volsplat.protocol.rules.index_rules import Quantisation


@dataclass(frozen=True)
class PackedBlock:
    """All that follows from a block's values."""

    box: Box
    packets: Packets
    means: BlockScalars | None  # for the next level, if there is one
    extents: NDArray[np.uint8]  # of its bricks, (bk, bj, bi, BRICK_FIELDS)


@dataclass(frozen=True)
class LevelPacker:
    """Packs one level. `source` gives its scalars, `coarser` takes those of the next, `extents` what bricks hold."""

    number: int
    geometry: Geometry
    quantisation: Quantisation
    background: int
    layout: Layout
    source: Scalars
    coarser: StoredScalars | None
    extents: LevelSource

    def pack(self, blocks: list[Box], in_advance: int, writer: StoreWriter, journal: Journal) -> Iterator[Box]:
        """Packs and stores blocks; each is yielded once it stands in the journal. `in_advance` are packed meanwhile."""
        for packed in ahead(self._packed, blocks, in_advance):
            checksums = {}
            for shard in self.layout.shards(self.geometry.dims, packed.box):
                part = packed.packets[shard.slices(packed.box.low)]
                checksums[writer.shard_name(self.number, shard)] = writer.write_shard(self.number, shard, part)
            self._lay_down(packed)
            journal.finish_shards(checksums)
            box = packed.box
            del packed, part  # before the next one is made
            yield box

    def _packed(self, box: Box) -> PackedBlock:
        sub_cube = SubCube(self.geometry, box, self.source.second_range)
        with_halo = box.grown(HALO, self.geometry.dims)
        read = self.source.read(box, with_halo)
        sub_cube.hold(*read)
        sub_cube.pack(self.quantisation)
        packets = np.asarray(memoryview(sub_cube.packets))
        inside = BlockScalars(read.values[box.slices(with_halo.low)], read.second)
        means = None if self.coarser is None else _halved(inside)
        return PackedBlock(box, packets, means, brick_extents(packets, self.layout.brick, self.background))

    def _lay_down(self, packed: PackedBlock) -> None:
        if self.coarser is not None and packed.means is not None:
            self.coarser.write(halved_box(packed.box), packed.means)
        nk, nj, ni, _ = packed.extents.shape
        i, j, k = (low // self.layout.brick for low in packed.box.low)
        bricks = Box((i * BRICK_FIELDS, j, k), ((i + ni) * BRICK_FIELDS, j + nj, k + nk))
        self.extents.write(bricks, packed.extents.reshape(nk, nj, -1))


def _halved(block: BlockScalars) -> BlockScalars:
    values, second = block
    return BlockScalars(halved(values), None if second is None else halved_second(values, second))
