"""Makes a packet store of a volume, from reading its header to marking the store as complete."""

import math
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.packet_store import (
    BRICK_FIELDS,
    BRICKS,
    COLUMNS,
    MIXTURES,
    PREPARING,
    Source,
    StoreAttributes,
    StoredLevel,
    attributes_of,
    has_attributes,
)
from volsplat.mapshade_server.held.sheet_reader import BYTES_AT_ONCE, SheetReader
from volsplat.mapshade_server.held.volume_identity import identified_volume, identity_of
from volsplat.mapshade_server.prepare.executor import Executor, Threads
from volsplat.mapshade_server.prepare.halving import mean_type
from volsplat.mapshade_server.prepare.journal import Journal, Wish, alone, check_source, other_options
from volsplat.mapshade_server.prepare.layout import MIB, PROGRAM_BYTES, Layout, memory_plan
from volsplat.mapshade_server.prepare.level_packing import LevelPacker
from volsplat.mapshade_server.prepare.level_source import LevelSource
from volsplat.mapshade_server.prepare.machines import Machines
from volsplat.mapshade_server.prepare.mixture_files import ColumnFiles, MixtureFiles
from volsplat.mapshade_server.prepare.progress import Progress
from volsplat.mapshade_server.prepare.run_mark import marked
from volsplat.mapshade_server.prepare.scalars import Scalars, StoredScalars, volume_scalars
from volsplat.mapshade_server.prepare.shared_volume import SharedVolume
from volsplat.mapshade_server.prepare.store_writer import ShardPlace, StoreWriter, begin_store, brick_dims, sweep
from volsplat.mapshade_server.prepare.survey import survey_volume
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.program.task_pool import TaskPool
from volsplat.protocol.description.volume import Box, Geometry, Index, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.description.volume_name import absolute_name, volume_name
from volsplat.protocol.rules.levels import factors_of
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.text.errors import BadInput

UNPACKED = "source"
FIRST_VOXEL = Box((0, 0, 0), (1, 1, 1))


@dataclass(frozen=True)
class Options:
    """What a person chooses. `memory` is in bytes, of each process; the tests alone change the layout."""

    window: tuple[float, float] | None = None
    directions: Literal["octahedral", "paper"] = "octahedral"
    memory: int = 1024 * MIB
    verify: bool = True
    layout: Layout = Layout()


@dataclass(frozen=True)
class Prepared:
    """What became of it."""

    attributes: StoreAttributes
    source_bytes: int  # of the voxels, unpacked
    seconds: float  # 0 if the store was complete before


def prepare(volume: str, out: Path, options: Options, progress: Progress, pool: TaskPool | None = None) -> Prepared:
    """Makes the store at `out`, or goes on with it, by the machines of a pool if there is one.

    Raises BadInput, and OSError if the disk refuses.
    """
    preparation = Preparation(volume, out, options, progress)
    seconds = 0.0
    if not preparation.is_done():
        started = time.perf_counter()
        with alone(out, progress):
            preparation.run(pool)
        seconds = time.perf_counter() - started
    shutil.rmtree(out / PREPARING, ignore_errors=True)
    return Prepared(attributes_of(out), preparation.source_bytes, seconds)


class Preparation:
    """One volume on its way into one store."""

    def __init__(self, volume: str, out: Path, options: Options, progress: Progress) -> None:
        library("zarr", f"{out}: a packet store")
        self._volume = volume
        self._out = out
        self._options = options
        self._progress = progress
        self._is_far = volume_name(volume).is_url
        self._reader, self._identity = identified_volume(volume)
        self._description = self._reader.description
        self._scalars = volume_scalars(self._reader)
        second = self._scalars.second
        self._second_type = None if second is None else second(FIRST_VOXEL).dtype
        dims, scalar_type = self._description.geometry.dims, self._description.scalar_type
        self._wish = Wish(_source(volume, self._identity), options.window, options.directions, options.layout)
        self._levels = options.layout.levels(self._description.geometry)
        item_bytes = np.dtype(scalar_type).itemsize
        more_bytes = [] if self._second_type is None else [self._second_type.itemsize]
        greatest = max(item_bytes, np.dtype(mean_type(scalar_type)).itemsize)
        self._item_bytes = sum([item_bytes, *more_bytes])  # of a voxel
        rows = self._description.chunk[0] > options.layout.shard or not self._description.reads_sub_cubes
        held_bytes = [greatest, *more_bytes, VOXEL_PACKET_BYTES]  # gradients of coarser levels are as packets
        of_mean = min((math.prod(factors_of(*pair)) for pair in pairwise(self._levels)), default=8)
        self._plan = memory_plan(options.layout, dims, held_bytes, options.memory, rows, of_mean)

    @property
    def source_bytes(self) -> int:
        return self._description.geometry.box.voxels * self._item_bytes

    def is_done(self) -> bool:
        """Whether the store is complete. Raises BadInput if something else stands in its place."""
        if not has_attributes(self._out):
            if self._out.exists() and not (self._out / PREPARING).is_dir() and not _is_empty_folder(self._out):
                raise BadInput(f"{self._out}: is there already and is no packet store; name another place")
            return False
        there = attributes_of(self._out)
        check_source(self._out, there.source, self._wish.source)
        asked = (self._wish.window or there.quantisation.window, self._wish.directions)
        if asked != (there.quantisation.window, there.quantisation.directions):
            raise other_options(self._out)
        return there.complete

    def run(self, pool: TaskPool | None) -> None:
        """From wherever an earlier run was ended to the finished store."""
        _kernels.give_freed_memory_back()  # threads pack blocks whose means are of many sizes
        journal = Journal(self._out, self._wish)
        sweep(self._out)
        with self._executor(pool, journal) as executor:
            source = self._source(journal, executor)
            if journal.is_new or not has_attributes(self._out):
                self._survey(source, journal, executor)
            attributes = attributes_of(self._out)
            writer = StoreWriter(self._out.absolute(), attributes, self._options.layout)
            self._pack(source, attributes, writer, journal, executor)
            if self._options.verify:
                self._verify(writer, journal, executor)
        sweep(self._out)  # what a machine was about to write when it was lost
        self._check_unchanged()
        writer.finish()

    @contextmanager
    def _executor(self, pool: TaskPool | None, journal: Journal) -> Iterator[Executor]:
        if pool is None:
            yield Threads(self._plan.blocks)
            return
        with marked(journal.folder) as mark:
            volume = SharedVolume(absolute_name(self._volume), self._identity, mark)
            machines = Machines(pool, mark, volume, self._progress)
            try:
                machines.check(reads_volume=not self._is_copied)
            except BadInput:
                if journal.is_new:
                    journal.withdraw()
                raise
            yield machines

    def _check_unchanged(self) -> None:
        """Raises BadInput unless the volume is still the one that was opened."""
        found = identity_of(self._volume, self._reader)
        difference = found.difference(self._identity)
        if difference:
            raise BadInput(
                f"{self._volume}: was replaced or changed while it was prepared: {difference}; "
                f"delete {self._out}, begin anew"
            )

    @property
    def _is_copied(self) -> bool:
        """Whether blocks of it cost too much."""
        return self._is_far or not self._description.reads_sub_cubes

    def _source(self, journal: Journal, executor: Executor) -> Scalars:
        """The scalars of level 0: from the volume itself, or from a raw copy."""
        if not self._is_copied:
            return executor.reached(self._scalars)
        dims = self._description.geometry.dims
        copy = self._stored(journal, UNPACKED, dims, self._description.scalar_type)
        if not journal.state.unpacked:
            self._progress.begin("copying", self.source_bytes)
            sheet_bytes = dims[0] * dims[1] * self._item_bytes
            sheets = max(1, (self._options.memory - PROGRAM_BYTES) // (2 * sheet_bytes))
            for k in range(0, dims[2], sheets):
                part = Box((0, 0, k), (dims[0], dims[1], min(k + sheets, dims[2])))
                copy.write(part, self._scalars.read(part, part))
                self._progress.advance(part.voxels * self._item_bytes)
            journal.finish_unpacking()
        return copy

    def _stored(self, journal: Journal, name: str, dims: Index, scalar_type: str) -> StoredScalars:
        """Scalars of a grid in raw files of this name, the values of this type."""
        second = None
        if self._second_type is not None:
            second = LevelSource(journal.folder / f"{name}-second.raw", dims, self._second_type.name)
        values = LevelSource(journal.folder / f"{name}.raw", dims, scalar_type)
        gradients = None
        if name != UNPACKED:
            gradients = LevelSource(journal.folder / f"{name}-gradients.raw", dims, "uint32")
        return StoredScalars(values, second, self._description.second_scalar, (dims[0], 1, 1), gradients)

    def _survey(self, source: Scalars, journal: Journal, executor: Executor) -> None:
        """Surveys the volume and begins the store."""
        geometry = self._description.geometry
        room = (self._options.memory - PROGRAM_BYTES) // (2 * (self._plan.blocks + 2))  # two of each while one is read
        reader = SheetReader(
            geometry,
            self._description.scalar_type,
            source.chunk,
            source.values,
            source.second,
            source.second_range,
            bytes_at_once=min(BYTES_AT_ONCE, room),
        )
        brick = self._options.layout.brick
        try:
            surveyed = survey_volume(reader, self._description, brick, executor, self._item_bytes, self._progress)
        except BadInput:
            journal.withdraw()
            raise
        quantisation = surveyed.quantisation(self._description, self._options.window, self._options.directions)
        attributes = StoreAttributes(
            complete=False,
            source=self._wish.source,
            description=_told_by_store(self._description, self._volume),
            survey=surveyed.survey,
            quantisation=quantisation,
            background=surveyed.background(self._description, quantisation),
            levels=tuple(StoredLevel(str(n), level) for n, level in enumerate(self._levels)),
        )
        begin_store(self._out, attributes, self._options.layout, surveyed)

    def _pack(
        self, source: Scalars, attributes: StoreAttributes, writer: StoreWriter, journal: Journal, executor: Executor
    ) -> None:
        """Packs what the journal does not have of all levels, then stores what their bricks hold."""
        missing = self._begin_packing(writer, journal)
        layout, scalar_type = self._options.layout, mean_type(self._description.scalar_type)
        for n, geometry in enumerate(self._levels):
            coarser, factors = None, (1, 1, 1)
            if n + 1 < len(self._levels):
                coarser = self._stored(journal, str(n + 1), self._levels[n + 1].dims, scalar_type)
                factors = factors_of(geometry, self._levels[n + 1])
            held = brick_dims(geometry.dims, layout.brick)
            extents = LevelSource(journal.folder / f"{BRICKS}-{n}.raw", held, "uint8")
            mixtures = MixtureFiles(journal.folder / f"{MIXTURES}-{n + 1}")
            columns = ColumnFiles(journal.folder / f"{COLUMNS}-{n + 1}")
            packer = LevelPacker(
                n,
                geometry,
                attributes.quantisation,
                attributes.background_at(n),
                layout,
                source,
                coarser,
                factors,
                extents,
                mixtures,
                columns,
            )
            for stored in executor.stored_blocks(packer, writer, missing[n]):
                packer.finish(stored, journal)
                voxels = stored.besides.box.voxels
                del stored  # before the next one is made
                self._progress.advance(voxels * self._item_bytes)
            whole = extents(Box((0, 0, 0), held))
            writer.write_bricks(n, whole.reshape(held[2], held[1], -1, BRICK_FIELDS))
            if coarser is not None:
                writer.write_mixture(n + 1, mixtures.joined())
                writer.write_columns(n + 1, columns.joined(self._levels[n + 1].dims))
                source = coarser

    def _begin_packing(self, writer: StoreWriter, journal: Journal) -> list[list[Box]]:
        """The blocks of each level of which the journal lacks a shard."""
        blocks = [self._blocks(level) for level in self._levels]
        missing = [
            [block for block in of_level if not self._is_finished(n, block, writer, journal)]
            for n, of_level in enumerate(blocks)
        ]
        voxels, left = (sum(block.voxels for of_level in some for block in of_level) for some in (blocks, missing))
        if left < voxels:
            self._progress.note(f"resuming: {100 * (voxels - left) // voxels} % done")
        self._progress.begin("packing", voxels * self._item_bytes)
        self._progress.advance((voxels - left) * self._item_bytes)
        return missing

    def _verify(self, writer: StoreWriter, journal: Journal, executor: Executor) -> None:
        """Raises BadInput if what is stored is not what was made, and forgets it, so that it is made again."""
        places = [
            ShardPlace(n, shard)
            for n, level in enumerate(self._levels)
            for block in self._blocks(level)
            for shard in self._options.layout.shards(level.dims, block)
        ]
        self._progress.begin("checking", sum(place.shard.voxels for place in places) * self._item_bytes)
        damaged = []
        for place, checksum in executor.checksums(writer, places):
            name = writer.shard_name(*place)
            if checksum != journal.state.shards[name]:
                damaged.append(name)
            self._progress.advance(place.shard.voxels * self._item_bytes)
        if damaged:
            journal.forget_shards(damaged)
            raise BadInput(
                f"{self._out}: {len(damaged)} of {len(places)} shards came back from the disk other than they were "
                "written; check the disk, and run the same command again, which writes them anew"
            )

    def _blocks(self, level: Geometry) -> list[Box]:
        return list(self._options.layout.blocks(level.dims, self._plan.shards_in_a_row))

    def _is_finished(self, level: int, block: Box, writer: StoreWriter, journal: Journal) -> bool:
        shards = self._options.layout.shards(self._levels[level].dims, block)
        return all(writer.shard_name(level, shard) in journal.state.shards for shard in shards)


def _source(volume: str, identity: VolumeIdentity) -> Source:
    name = volume_name(volume)
    shown = name if name.is_url else name._replace(place=Path(name.place).name)
    return Source(str(shown), identity.at_no_place())


def _told_by_store(description: VolumeDescription, volume: str) -> VolumeDescription:
    """A description as the store has it, whose notes name the folder of no volume, and cures that act on the store."""
    place = Path(volume_name(volume).place)
    notes = tuple(
        note.replace(str(place), place.name)
        + ("; for the store prepare it anew from that" if f"{place}#" in note else "")
        for note in description.warnings
    )
    return msgspec.structs.replace(description, reads_sub_cubes=True, why_whole="", chunk=(1, 1, 1), warnings=notes)


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
