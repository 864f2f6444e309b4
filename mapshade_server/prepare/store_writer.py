"""Lays down a packet store: metadata, shards, and what each brick holds."""

import os
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.held.level_columns import Rows
from volsplat.mapshade_server.held.packet_store import (
    BLOCKS,
    BRICK_FIELDS,
    BRICKS,
    COLUMNS,
    DENSITY_COUNTS,
    METADATA,
    MIXTURES,
    STRENGTH_COUNTS,
    Packets,
    StoreAttributes,
)
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.mapshade_server.prepare.mixture_files import Mixture
from volsplat.mapshade_server.prepare.survey import Surveyed
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.description.block_extremes import block_dims
from volsplat.protocol.description.volume import Box, Index

ZSTD_LEVEL = 1  # chosen for speed: docs/howto/prepare.md has the others' rates
AXES = ("k", "j", "i")


class ShardPlace(NamedTuple):
    level: int
    shard: Box


class StoreWriter:
    """The store at `out`, which is there with all its metadata, by `begin_store` or since an earlier run."""

    def __init__(self, out: Path, attributes: StoreAttributes, layout: Layout) -> None:
        self._made_of = (out, attributes, layout)
        self._out = out
        self._layout = layout
        self._attributes = attributes
        self._group = _group(out)
        self._arrays = [self._group[level.path] for level in attributes.levels]

    def __reduce__(self) -> tuple[type["StoreWriter"], tuple[Path, StoreAttributes, Layout]]:
        """Where it is unpickled, the store is opened anew."""
        return (StoreWriter, self._made_of)

    def write_shard(self, level: int, shard: Box, packets: Packets) -> int:
        """Stores a shard for good, in the place of what an earlier run may have left. The CRC-32 of its packets."""
        whole = np.ascontiguousarray(packets)
        self._arrays[level][shard.slices()] = whole
        _onto_disk(self._out / self.shard_name(level, shard, "c"))
        return zlib.crc32(whole.data)

    def read_checksum(self, place: ShardPlace) -> tuple[ShardPlace, int | None]:
        """As `write_shard` gave it, of the shard that is stored there; None if it cannot be read."""
        try:
            return place, zlib.crc32(np.ascontiguousarray(self._arrays[place.level][place.shard.slices()]).data)
        except (OSError, ValueError, RuntimeError):
            return place, None

    def shard_name(self, level: int, shard: Box, *prefix: str) -> str:
        """The level's path and the shard's place, as the files are named."""
        stored = self._attributes.levels[level]
        size = self._layout.shard_size(stored.geometry.dims)
        place = (str(shard.low[axis] // size[axis]) for axis in (2, 1, 0))
        return "/".join((stored.path, *prefix, *place))

    def write_bricks(self, level: int, extents: NDArray[np.uint8]) -> None:
        """Stores what all bricks of a level hold, (bk, bj, bi, BRICK_FIELDS)."""
        name = f"{BRICKS}/{self._attributes.levels[level].path}"
        _write_whole(self._group, name, extents, (*AXES, "extent"))

    def write_mixture(self, level: int, mixture: Mixture) -> None:
        """Stores what the voxels of a level stand for."""
        steps = np.diff(mixture.keys.astype(np.uint64), prepend=np.uint64(0))
        name = f"{MIXTURES}/{self._attributes.levels[level].path}"
        _write_whole(self._group, name, np.stack((steps, mixture.counts)), ("entry", "number"))

    def write_columns(self, level: int, rows: Iterable[Rows]) -> None:
        """Stores columns through a level, those in one direction after the other."""
        for number, of_direction in enumerate(rows):
            name = f"{COLUMNS}/{self._attributes.levels[level].path}/{number}"
            _write_whole(self._group, name, of_direction, ("voxel", "packet"))

    def finish(self) -> None:
        """Marks the store as complete, once all of it is on the disk."""
        for folder in (BRICKS, MIXTURES, COLUMNS):
            _onto_disk(self._out / folder)
        _set_attributes(self._group, msgspec.structs.replace(self._attributes, complete=True))
        _onto_disk(self._out / METADATA)


def begin_store(out: Path, attributes: StoreAttributes, layout: Layout, surveyed: Surveyed) -> None:
    """Lays down all metadata of a store without shards; the attributes last, for they say that the rest is there."""
    group = _group(out)
    _write_whole(group, DENSITY_COUNTS, surveyed.density_counts, ("bin",))
    _write_whole(group, STRENGTH_COUNTS, surveyed.strength_counts, ("bin",))
    blocks = block_dims(attributes.levels[0].geometry.dims)
    _write_whole(group, BLOCKS, np.array(surveyed.extremes).reshape(2, *blocks[::-1]), ("extreme", *AXES))
    for n, level in enumerate(attributes.levels):
        dims = level.geometry.dims
        group.create_array(
            level.path,
            shape=dims[::-1],
            chunks=(layout.brick,) * 3,
            shards=layout.shard_size(dims)[::-1],
            dtype="uint32",
            compressors=_compressor(),
            fill_value=attributes.background_at(n),
            dimension_names=AXES,
            overwrite=True,
        )
    _set_attributes(group, attributes)
    _onto_disk(out)


def brick_dims(dims: Index, brick: int) -> Index:
    """Of the grid of bytes that describe a level's bricks, BRICK_FIELDS to each along i."""
    ni, nj, nk = (-(-n // brick) for n in dims)
    return (ni * BRICK_FIELDS, nj, nk)


def sweep(out: Path) -> None:
    """Removes what Zarr was about to write when an earlier run was killed."""
    for partial in out.rglob("*.partial"):
        partial.unlink()


def _compressor() -> Any:
    """With a checksum: bricks that do not compress lie in a file as they are, and any change of it would be drawn."""
    return library("zarr.codecs", "a packet store").ZstdCodec(level=ZSTD_LEVEL, checksum=True)


def _group(out: Path) -> Any:
    return library("zarr", f"{out}: a packet store").open_group(str(out), mode="a")


def _write_whole(group: Any, name: str, values: NDArray[Any], names: tuple[str, ...]) -> None:
    array = group.create_array(
        name,
        shape=values.shape,
        chunks=values.shape,
        dtype=values.dtype,
        compressors=_compressor(),
        dimension_names=names,
        config={"write_empty_chunks": True},  # whose file is missing counts as damaged, and zeros are told as well
        overwrite=True,
    )
    array[...] = values


def _set_attributes(group: Any, attributes: StoreAttributes) -> None:
    group.update_attributes(attributes.as_attributes())


def _onto_disk(path: Path) -> None:
    """Waits until the disk has a file or a folder's files, and frees their memory.

    A shard that is all background has no file.
    """
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    for file in files:
        descriptor = os.open(file, os.O_RDONLY)
        try:
            os.fsync(descriptor)
            if hasattr(os, "posix_fadvise"):
                os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
        finally:
            os.close(descriptor)
