"""The packet store: a volume's voxel packets on disk, at several resolutions, ready to be drawn.

A Zarr v3 group that `volsplat prepare` writes:

    zarr.json            attribute "volsplat": StoreAttributes, as builtins; "volsplat_crc32": that of their JSON
    0, 1, 2, …           uint32 voxel packets of each level shaped (k, j, i), finest first; see packet_layout. Inner
                         chunks are bricks of 64^3 voxels, shards 256^3 (less in small volumes), compressed by
                         zstd with its checksum. A brick of nothing but the background is not stored, it is the fill
                         value; nor is the file of a shard of such bricks.
    bricks/0, …          uint8 (bk, bj, bi, 5): least and greatest density byte, least and greatest strength byte of
                         the voxels of each brick that have data, least > greatest if none has; 1 if the brick
                         is stored, else 0
    mixtures/1, …        uint64 (2, n): what the voxels of each level but the first stand for (level_mixture): by how
                         much each key exceeds the one before, and its count
    columns/1/0, …       uint32 (n, 9): voxels of columns through each level but the first, in each of DIRECTIONS, each
                         packet followed by the eight that it stands for (level_columns)
    histograms/density   int64 counts over the survey's low..high
    histograms/strength  int64 counts over 0..max_gradient, or over the range of a second scalar
    blocks               float64 (2, bk, bj, bi): least and greatest values of the volume's blocks (block_extremes)

Level L + 1 halves the axes of level L whose steps are short: each of its voxels is the mean of up to 2x2x2 source
values, as many as there are and are finite.
Its strength is the mean of theirs, its direction that of their sum, in the code "rough" of index_rules. A second
scalar, which strength stands for here too, is that of the voxel among them with the greatest value. All levels have one
quantisation. Packets hold their gradients, so a brick needs no halo.

All that lies on the disk bears a checksum: the attributes theirs, bricks, mixtures, columns and histograms zstd's, the
indices of shards the CRC-32C that Zarr gives them. What was changed since is refused by its file's name.
"""

import errno
import json
import math
import os
import zlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.held.level_columns import ROW, LevelColumns, columns_of
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.mapshade_server.readers.reading.bounded_unpacking import check_promise
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.file_marks import check_is_file
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile
from volsplat.mapshade_server.readers.zarr_arrays.zarr_codecs import bounded_codecs
from volsplat.mapshade_server.readers.zarr_arrays.zarr_files import files_of_arrays
from volsplat.mapshade_server.readers.zarr_arrays.zarr_folder import PACKET_STORE, folder_store
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims
from volsplat.protocol.description.volume import Box, Geometry, VolumeDescription
from volsplat.protocol.description.volume_identity import VolumeIdentity
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, ROUGH_NO_GRADIENT, Quantisation, Survey
from volsplat.protocol.rules.packet_layout import (
    DIRECTION_SHIFT,
    MOST_MIXTURE_ENTRIES,
    NO_DATA_BIT,
    VOXEL_PACKET_BYTES,
)
from volsplat.protocol.text.errors import BadInput

Packets = NDArray[np.uint32]  # shaped (k, j, i), C-contiguous

CHECKSUM = "volsplat_crc32"  # of the attribute
FORMAT = 12
PREPARE_ANEW = "delete it and run `volsplat prepare` again"
BRICKS = "bricks"
MIXTURES = "mixtures"
COLUMNS = "columns"
DENSITY_COUNTS, STRENGTH_COUNTS = "histograms/density", "histograms/strength"
BLOCKS = "blocks"
METADATA = "zarr.json"
PREPARING = ".prepare"  # the folder in a store that is being made, with
JOURNAL = "journal.json"  # what is finished
BRICK_FIELDS = 5  # least and greatest density byte, least and greatest strength byte, whether it is stored
STORED = 4
NO_KEY = (1 << 32) - 1  # of any entry of a mixture


class StoredLevel(msgspec.Struct, frozen=True):
    """One resolution: the array that holds it, and its place in space."""

    path: str
    geometry: Geometry


class Source(msgspec.Struct, frozen=True):
    """What a store was made from, so that another volume is not taken for it. Nothing of the folder that it lay in."""

    name: str  # without its folder; all of a URL
    identity: VolumeIdentity  # at no place


class StoreAttributes(msgspec.Struct, frozen=True, kw_only=True):
    """What a store says of itself. Fields that it does not know, a reader passes over."""

    format: int = FORMAT
    complete: bool
    source: Source
    description: VolumeDescription  # of level 0
    survey: Survey
    quantisation: Quantisation
    background: int  # the packet of all voxels in bricks of level 0 that are not stored
    levels: Annotated[tuple[StoredLevel, ...], msgspec.Meta(min_length=1)]

    def background_at(self, level: int) -> int:
        """The background of a level: it has no gradient, which coarser ones say in another code."""
        if level == 0 or self.background >> NO_DATA_BIT:
            return self.background
        return self.background & (1 << DIRECTION_SHIFT) - 1 | ROUGH_NO_GRADIENT << DIRECTION_SHIFT

    def as_attributes(self) -> dict[str, Any]:
        """The group's attributes: these, and their checksum."""
        told: dict[str, Any] = msgspec.to_builtins(self)
        return {PACKET_STORE: told, CHECKSUM: _checksum(told)}


class PacketStore:
    """A finished store, opened by `open_store`."""

    def __init__(self, place: str, group: Any, attributes: StoreAttributes) -> None:
        self._place = place
        self._group = group
        self.description = attributes.description
        self.survey = attributes.survey
        self.quantisation = attributes.quantisation
        self.levels = tuple(level.geometry for level in attributes.levels)
        self._paths = [level.path for level in attributes.levels]
        self._arrays = [self._packets(level, attributes.background_at(n)) for n, level in enumerate(attributes.levels)]
        self._check_bricks()
        self._bricks: dict[int, NDArray[np.uint8]] = {}
        self._mixtures: dict[int, LevelMixture] = {}

    @cached_property
    def density_counts(self) -> list[int]:
        counts: list[int] = self._whole(DENSITY_COUNTS, (HISTOGRAM_BINS,), np.int64).tolist()
        return counts

    @cached_property
    def strength_counts(self) -> list[int]:
        counts: list[int] = self._whole(STRENGTH_COUNTS, (HISTOGRAM_BINS,), np.int64).tolist()
        return counts

    @cached_property
    def extremes(self) -> BlockExtremes:
        shape = (2, *block_dims(self.levels[0].dims)[::-1])
        return BlockExtremes.of_bytes(self._whole(BLOCKS, shape, np.float64).tobytes())

    @property
    def files(self) -> Sequence[VolumeFile]:
        """What tells this store from another one: its documents and some shards of each level."""
        return files_of_arrays(Path(self._place), self._arrays)

    @property
    def brick_size(self) -> int:
        """Voxels along each side of a brick, the least that is read at once."""
        size: int = self._arrays[0].chunks[0]
        return size

    def read(self, level: int, box: Box) -> Packets:
        """The packets of a box of a level's grid. Only the bricks that the box touches are read; threads unpack them.

        Raises BadInput if the store turns out to be damaged.
        """
        array = self._arrays[level]
        self._check_shards(level, box)
        try:
            packets: Packets = np.ascontiguousarray(array[box.slices()])
        except (OSError, ValueError, RuntimeError) as error:
            for shard in self._shards(level, box):
                self._read(self._shard_name(level, shard), array, shard.slices())
            raise self._unread(self._paths[level], error) from None
        return packets

    def bricks(self, level: int) -> NDArray[np.uint8]:
        """What each brick holds: (bk, bj, bi, BRICK_FIELDS), see the module. For leaving out what cannot be seen."""
        if level not in self._bricks:
            shape = (*(-(-n // self.brick_size) for n in self.levels[level].dims[::-1]), BRICK_FIELDS)
            self._bricks[level] = self._whole(f"{BRICKS}/{self._paths[level]}", shape, np.uint8)
        return self._bricks[level]

    def mixture(self, level: int) -> LevelMixture | None:
        """What the voxels of a level stand for; None if they are the volume's own."""
        if level == 0:
            return None
        if level not in self._mixtures:
            finer = self.mixture(level - 1)
            self._mixtures[level] = self._mixture(self._paths[level], finer, self._columns(level))
        return self._mixtures[level]

    def _mixture(self, name: str, finer: LevelMixture | None, columns: LevelColumns) -> LevelMixture:
        path = f"{MIXTURES}/{name}"
        entries = self._array(path).shape[-1:]
        if entries > (MOST_MIXTURE_ENTRIES,):
            raise self._damaged(f"{path}/{METADATA}", "is not what was written")
        steps, counts = self._whole(path, (2, *entries), np.uint64)
        try:
            keys = np.cumsum(steps)
            return LevelMixture(finer, np.minimum(keys, NO_KEY).astype(np.uint32), counts, columns)
        except (ValueError, TypeError):
            raise self._damaged(path, "is not what was written") from None

    def _columns(self, level: int) -> LevelColumns:
        path = f"{COLUMNS}/{self._paths[level]}"
        volume, finer, own = (self.levels[n] for n in (0, level - 1, level))
        rows = (
            self._whole(f"{path}/{number}", (columns.rows, ROW), np.uint32)
            for number, columns in enumerate(columns_of(own.dims))
        )
        try:
            return LevelColumns(volume, finer, own, rows)
        except ValueError:
            raise self._damaged(path, "is not what was written") from None

    def _check_shards(self, level: int, box: Box) -> None:
        """Raises BadInput if the file of a shard is missing that has a stored brick in the box."""
        stored = self.bricks(level)[..., STORED]
        for shard in self._shards(level, box):
            within = tuple(
                slice(part.start // self.brick_size, -(-part.stop // self.brick_size)) for part in shard.slices()
            )
            if stored[within].any():
                self._check_is_there(self._shard_name(level, shard))

    def _shards(self, level: int, box: Box) -> Iterator[Box]:
        """The parts of the box that lie in one shard each."""
        sk, sj, si = self._arrays[level].shards
        for sheets in box.layers(2, sk):
            for rows in sheets.layers(1, sj):
                yield from rows.layers(0, si)

    def _shard_name(self, level: int, within: Box) -> str:
        """The file of the shard that the box lies in."""
        place = (low // size for low, size in zip(reversed(within.low), self._arrays[level].shards, strict=True))
        return "/".join([self._paths[level], "c", *map(str, place)])

    def _packets(self, level: StoredLevel, background: int) -> Any:
        array = self._array(level.path)
        if (array.shape, array.dtype, array.fill_value) != (level.geometry.dims[::-1], np.uint32, background):
            raise self._damaged(f"{level.path}/{METADATA}", "is not what was written")
        return array

    def _check_bricks(self) -> None:
        """Raises BadInput unless all levels lie in shards of bricks of one size, which fit the level."""
        for path, array in zip(self._paths, self._arrays, strict=True):
            if array.shards is None or array.chunks != (self.brick_size,) * 3:
                raise self._damaged(f"{path}/{METADATA}", "is not what was written")
            check_promise(f"{self._place}/{path}", math.prod(array.shards) * VOXEL_PACKET_BYTES, array.nbytes)

    def _array(self, path: str) -> Any:
        try:
            with bounded_codecs():
                found = self._group[path]
        except KeyError:
            raise self._damaged(path, "is missing") from None
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise self._unread(f"{path}/{METADATA}", error) from None
        if not hasattr(found, "shape"):
            raise self._damaged(path, "is a group")
        return found

    def _whole(self, path: str, shape: tuple[int, ...], dtype: type[np.generic]) -> NDArray[Any]:
        """An array that lies in one file. What its document says is under no checksum, so that it is compared first."""
        array = self._array(path)
        if (array.shape, array.chunks, array.dtype) != (shape, shape, dtype):
            raise self._damaged(f"{path}/{METADATA}", "is not what was written")
        name = "/".join([path, "c", *["0"] * array.ndim])
        self._check_is_there(name)
        values: NDArray[Any] = self._read(name, array, ...)
        return values

    def _check_is_there(self, name: str) -> None:
        """Raises BadInput if a file is missing, which Zarr would take for nothing but its fill value."""
        if Path(self._place).is_dir() and not Path(self._place, name).is_file():
            raise self._damaged(name, "is missing")

    def _read(self, path: str, array: Any, selection: Any) -> Any:
        try:
            return array[selection]
        except (OSError, ValueError, RuntimeError) as error:
            raise self._unread(path, error) from None

    def _damaged(self, path: str, what: str) -> BadInput:
        return BadInput(f"{self._place}: is damaged: its {path} {what}; {PREPARE_ANEW}")

    def _unread(self, path: str, error: Exception) -> BadInput:
        """Where the system refuses a file the store may be whole, and nobody should delete it."""
        if isinstance(error, OSError) and error.errno not in (None, errno.ENOENT):
            reason = os.strerror(error.errno or 0)
            return BadInput(f"{self._place}: its {path} cannot be read ({reason}); check its permissions and its disk")
        return self._damaged(path, f"cannot be read ({' '.join(str(error).split())})")


def names_store(volume: str) -> bool:
    """Whether a volume's name is that of a packet store here, finished or not."""
    name = volume_name(volume)
    return not (name.is_far or name.part) and is_store(Path(name.plain_place))


def is_store(folder: Path) -> bool:
    """Whether a folder is a packet store, finished or not. Zarr is not imported for it."""
    return has_attributes(folder) or _has_journal(folder)


def has_attributes(folder: Path) -> bool:
    """Whether a packet store's volume has been surveyed: until then it has a journal alone."""
    return PACKET_STORE in _group_attributes(folder)


def _has_journal(folder: Path) -> bool:
    """False for what cannot be looked at, too, as a name that is too long: Path.is_file raises OSError for it."""
    return os.path.isfile(_journal(folder))


def _journal(folder: Path) -> Path:
    return folder / PREPARING / JOURNAL


def attributes_of(folder: Path) -> StoreAttributes:
    """What a packet store says of itself once it has attributes. Raises BadInput if there is none of this format."""
    return stored_attributes(str(folder), _group_attributes(folder))


def _group_attributes(folder: Path) -> dict[str, Any]:
    try:
        check_is_file(folder / METADATA)
        attributes = json.loads((folder / METADATA).read_bytes())["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return attributes if isinstance(attributes, dict) else {}


def open_store(place: str) -> PacketStore:
    """The store at a path or, with fsspec, a URL. Raises BadInput for what is no finished store."""
    place = volume_name(place).plain_place
    if _has_journal(Path(place)) and not has_attributes(Path(place)):
        raise _unfinished(place, _begun_from(Path(place)))
    zarr = library("zarr", f"{place}: a packet store")
    try:
        group = zarr.open_group(folder_store(place) if Path(place).is_dir() else place, mode="r")
    except (OSError, ValueError) as error:
        raise BadInput(f"{place}: no packet store can be opened here ({' '.join(str(error).split())})") from None
    attributes = stored_attributes(place, dict(group.attrs))
    if not attributes.complete:
        raise _unfinished(place, attributes.source.name)
    return PacketStore(place, group, attributes)


def _unfinished(place: str, source: str) -> BadInput:
    began = f"that began it from {source}" if source else "that began it"
    return BadInput(f"{place}: was not finished; run the `volsplat prepare` {began} once more")


def _begun_from(folder: Path) -> str:
    """The name of the volume that a journal tells; "" if it tells none."""
    try:
        name = json.loads(_journal(folder).read_bytes())["wish"]["source"]["name"]
    except (OSError, ValueError, KeyError, TypeError):
        return ""
    return name if isinstance(name, str) else ""


def stored_attributes(place: str, attributes: dict[str, Any]) -> StoreAttributes:
    """What the attributes of a group say. Raises BadInput if they are not those of a store of this format."""
    told = attributes.get(PACKET_STORE)
    if not isinstance(told, dict):
        raise BadInput(f"{place}: is no packet store; make one by `volsplat prepare VOLUME {place}`")
    if told.get("format") != FORMAT:
        raise BadInput(
            f"{place}: is a packet store of format {told.get('format')}, this version reads format {FORMAT}; "
            + PREPARE_ANEW
        )
    if attributes.get(CHECKSUM) != _checksum(told):
        raise BadInput(f"{place}: its attributes are not what was written; {PREPARE_ANEW}")
    try:
        return msgspec.convert(told, StoreAttributes)
    except msgspec.ValidationError as error:
        raise BadInput(f"{place}: its attributes are damaged ({error}); {PREPARE_ANEW}") from None


def _checksum(told: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(told, sort_keys=True).encode())
