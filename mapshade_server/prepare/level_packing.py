"""The second pass: packs one level block by block, and lays down the means that the next level is packed from."""

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.held.level_columns import PlacedRows, rows_within
from volsplat.mapshade_server.held.packet_store import BRICK_FIELDS, Packets
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.prepare.brick_extents import brick_extents
from volsplat.mapshade_server.prepare.gradient_means import halved_gradients, with_gradients
from volsplat.mapshade_server.prepare.halving import halved, halved_second
from volsplat.mapshade_server.prepare.journal import Journal
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.mapshade_server.prepare.level_source import LevelSource
from volsplat.mapshade_server.prepare.mixture_files import ColumnFiles, Mixture, MixtureFiles
from volsplat.mapshade_server.prepare.scalars import BlockScalars, Scalars, StoredScalars
from volsplat.mapshade_server.prepare.store_writer import StoreWriter
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import HALO, Box, Geometry, Index
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import bounds_at_level, dims_at_level


@dataclass(frozen=True)
class Besides:
    """What follows from a block's values besides its packets."""

    box: Box
    means: BlockScalars | None  # for the next level, if there is one
    mixtures: list[Mixture]  # of each shard, for the next level
    columns: list[PlacedRows]
    extents: NDArray[np.uint8]  # of its bricks, (bk, bj, bi, BRICK_FIELDS)


@dataclass(frozen=True)
class PackedBlock:
    packets: Packets
    besides: Besides


@dataclass(frozen=True)
class StoredBlock:
    """A block whose shards are on the disk, with the CRC-32 of each by its name."""

    checksums: dict[str, int]
    besides: Besides


@dataclass(frozen=True)
class LevelPacker:
    """Packs one level. `source` gives its scalars, `coarser` takes those of the next, `extents` what bricks hold.

    A voxel of the next level is made of `factors` of this one along i, j, k.
    """

    number: int
    geometry: Geometry
    quantisation: Quantisation
    background: int
    layout: Layout
    source: Scalars
    coarser: StoredScalars | None
    factors: Index
    extents: LevelSource
    mixtures: MixtureFiles  # of the next level
    columns: ColumnFiles  # likewise

    def packed(self, box: Box) -> PackedBlock:
        sub_cube = SubCube(self.geometry, box, self.source.second_range)
        with_halo = box.grown(HALO, self.geometry.dims)
        read = self.source.read(box, with_halo)
        sub_cube.hold(read.values, read.second)
        sub_cube.pack(self.quantisation)
        packets, has_strength = np.asarray(memoryview(sub_cube.packets)), self.quantisation.has_strength
        if read.gradients is not None:
            packets = with_gradients(packets, read.gradients, has_strength)
        means, mixtures, columns = None, [], []
        if self.coarser is not None:
            code = self.quantisation.directions if read.gradients is None else "rough"
            gradients = halved_gradients(packets, code, self.factors)
            means = self._halved(read.values[box.slices(with_halo.low)], read.second, gradients)
            packed_means = self._packed_means(means)
            mixtures = list(self._mixtures(box, packets, packed_means))
            columns = list(self._columns(box, packets, packed_means))
        extents = brick_extents(packets, self.layout.brick, self.background)
        return PackedBlock(packets, Besides(box, means, mixtures, columns, extents))

    def _packed_means(self, means: BlockScalars) -> Packets:
        """Packets as the next level will have them."""
        nk, nj, ni = means.values.shape
        part = msgspec.structs.replace(self.geometry, dims=(ni, nj, nk))
        sub_cube = SubCube(part, part.box, self.source.second_range)
        sub_cube.hold(means.values, means.second)
        sub_cube.pack(self.quantisation)
        packets = np.asarray(memoryview(sub_cube.packets))
        if means.gradients is None:
            return packets
        return with_gradients(packets, means.gradients, self.quantisation.has_strength)

    def _mixtures(self, box: Box, packets: Packets, coarser: Packets) -> Iterator[Mixture]:
        for shard in self.layout.shards(self.geometry.dims, box):
            there = self._in_coarser(shard).slices(self._in_coarser(box).low)
            yield Mixture.of_voxels(packets[shard.slices(box.low)], coarser[there])

    def _columns(self, box: Box, packets: Packets, coarser: Packets) -> Iterator[PlacedRows]:
        dims = dims_at_level(self.geometry.dims, self.factors)
        for shard in self.layout.shards(self.geometry.dims, box):
            means = self._in_coarser(shard)
            there = means.slices(self._in_coarser(box).low)
            yield rows_within(packets[shard.slices(box.low)], coarser[there], means.low, dims)

    def _in_coarser(self, box: Box) -> Box:
        """Where the means of a box lie."""
        return bounds_at_level(box, self.factors)

    def _halved(self, values: Voxels, second: Voxels | None, gradients: Packets) -> BlockScalars:
        chosen = None if second is None else halved_second(values, second, self.factors)
        return BlockScalars(halved(values, self.factors), chosen, gradients)

    def stored(self, packed: PackedBlock, writer: StoreWriter) -> StoredBlock:
        """Once its shards are on the disk."""
        checksums = {}
        box = packed.besides.box
        for shard in self.layout.shards(self.geometry.dims, box):
            part = packed.packets[shard.slices(box.low)]
            checksums[writer.shard_name(self.number, shard)] = writer.write_shard(self.number, shard, part)
        return StoredBlock(checksums, packed.besides)

    def finish(self, stored: StoredBlock, journal: Journal) -> None:
        """Lays down for good what follows from a block besides its packets, and has the journal say that it is done."""
        box, means, extents = stored.besides.box, stored.besides.means, stored.besides.extents
        if self.coarser is not None and means is not None:
            self.coarser.write(self._in_coarser(box), means)
            shards = self.layout.shards(self.geometry.dims, box)
            of_shards = zip(shards, stored.besides.mixtures, stored.besides.columns, strict=True)
            for shard, mixture, columns in of_shards:
                self.mixtures.write(shard, mixture)
                self.columns.write(shard, columns)
        nk, nj, ni, _ = extents.shape
        i, j, k = (low // self.layout.brick for low in box.low)
        bricks = Box((i * BRICK_FIELDS, j, k), ((i + ni) * BRICK_FIELDS, j + nj, k + nk))
        self.extents.write(bricks, extents.reshape(nk, nj, -1))
        journal.finish_shards(stored.checksums)
