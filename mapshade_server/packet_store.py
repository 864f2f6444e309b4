"""The packet store: a volume's voxel packets on disk, at several resolutions, ready to be drawn.

A Zarr v3 group that `volsplat prepare` writes:

    zarr.json            attribute "volsplat": StoreAttributes, as builtins
    0, 1, 2, …           uint32 voxel packets of each level shaped (k, j, i), finest first; see packet_layout. Inner
                         chunks are bricks of 64^3 voxels, shards 256^3 (less in small volumes), compressed by
                         zstd. What is not stored is no data.
    bricks/0, …          uint8 (bk, bj, bi, 4): least and greatest density byte, least and greatest strength byte of
                         the voxels of each brick that have data; least > greatest where none has
    histograms/density   int64 counts over the survey's low..high
    histograms/strength  int64 counts over 0..max_gradient, or over the range of a second scalar

Level L + 1 halves level L: each of its voxels is the mean of 2x2x2 source values, as many as there are and are finite.
A second scalar, which strength stands for here too, is that of the voxel among them with the greatest value. All
levels have one quantisation. Packets hold their gradients, so a brick needs no halo.
"""

import json
import math
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.extra import library
from volsplat.protocol.errors import BadInput
from volsplat.protocol.index_rules import Quantisation, Survey
from volsplat.protocol.volume import Box, Geometry, VolumeDescription

Packets = NDArray[np.uint32]  # shaped (k, j, i), C-contiguous

ATTRIBUTE = "volsplat"
FORMAT = 1
BRICKS = "bricks"
DENSITY_COUNTS, STRENGTH_COUNTS = "histograms/density", "histograms/strength"
METADATA = "zarr.json"
BRICK_FIELDS = 4  # least and greatest density byte, least and greatest strength byte


class StoredLevel(msgspec.Struct, frozen=True):
    """One resolution: the array that holds it, how often it is coarser than the source, and its place in space."""

    path: str
    factor: int
    geometry: Geometry


class Source(msgspec.Struct, frozen=True):
    """What a store was made from, so that another volume is not taken for it."""

    name: str
    size: int  # bytes
    modified: int  # nanoseconds since 1970


class StoreAttributes(msgspec.Struct, frozen=True, kw_only=True):
    """What a store tells of itself. Fields that it does not know, a reader passes over."""

    format: int = FORMAT
    complete: bool
    source: Source
    description: VolumeDescription  # of level 0
    survey: Survey
    quantisation: Quantisation
    levels: tuple[StoredLevel, ...]

    def as_builtins(self) -> dict[str, Any]:
        """For JSON, which has no infinite numbers: a survey without any value has neither low nor high."""
        builtins: dict[str, Any] = msgspec.to_builtins(self)
        if self.survey.low > self.survey.high:
            del builtins["survey"]["low"], builtins["survey"]["high"]
        return builtins

    @classmethod
    def from_builtins(cls, builtins: dict[str, Any]) -> "StoreAttributes":
        """Raises msgspec.ValidationError."""
        survey = {"low": math.inf, "high": -math.inf, **builtins.get("survey", {})}
        return msgspec.convert({**builtins, "survey": survey}, cls)


class Level(NamedTuple):
    """One resolution of a store; level 0 has factor 1."""

    factor: int
    geometry: Geometry


class PacketStore:
    """A finished store, opened by `open_store`."""

    def __init__(self, place: str, group: Any, attributes: StoreAttributes) -> None:
        self._place = place
        self._group = group
        self.description = attributes.description
        self.survey = attributes.survey
        self.quantisation = attributes.quantisation
        self.levels = tuple(Level(level.factor, level.geometry) for level in attributes.levels)
        self._paths = [level.path for level in attributes.levels]
        self._arrays = [self._array(path) for path in self._paths]

    @cached_property
    def density_counts(self) -> list[int]:
        counts: list[int] = self._array(DENSITY_COUNTS)[:].tolist()
        return counts

    @cached_property
    def strength_counts(self) -> list[int]:
        counts: list[int] = self._array(STRENGTH_COUNTS)[:].tolist()
        return counts

    @property
    def brick_size(self) -> int:
        """Voxels along each side of a brick, the least that is read at once."""
        size: int = self._arrays[0].chunks[0]
        return size

    def read(self, level: int, box: Box) -> Packets:
        """The packets of a box of a level's grid. Only the bricks that the box touches are read; threads unpack them.

        Raises BadInput where the store turns out to be damaged.
        """
        (i0, j0, k0), (i1, j1, k1) = box
        path = self._paths[level]
        packets: Packets = self._read(path, self._arrays[level], (slice(k0, k1), slice(j0, j1), slice(i0, i1)))
        return np.ascontiguousarray(packets)

    def bricks(self, level: int) -> NDArray[np.uint8]:
        """What each brick holds: (bk, bj, bi, 4), see the module. For leaving out what cannot be seen."""
        path = f"{BRICKS}/{self._paths[level]}"
        extents: NDArray[np.uint8] = self._read(path, self._array(path), slice(None))
        return extents

    def _array(self, path: str) -> Any:
        try:
            return self._group[path]
        except KeyError:
            raise self._damaged(path, "is missing") from None

    def _read(self, path: str, array: Any, selection: Any) -> Any:
        try:
            return array[selection]
        except (OSError, ValueError, RuntimeError) as error:
            raise self._damaged(path, f"cannot be read ({' '.join(str(error).split())})") from None

    def _damaged(self, path: str, what: str) -> BadInput:
        return BadInput(
            f"{self._place}: is damaged: its array {path} {what}; delete it and run `volsplat prepare` again"
        )


def is_store(folder: Path) -> bool:
    """Whether a folder is a packet store, finished or not. Zarr is not imported for it."""
    return ATTRIBUTE in _group_attributes(folder)


def attributes_of(folder: Path) -> StoreAttributes:
    """What a packet store tells, finished or not. Raises BadInput where there is none of this format."""
    return stored_attributes(str(folder), _group_attributes(folder))


def _group_attributes(folder: Path) -> dict[str, Any]:
    try:
        attributes = json.loads((folder / METADATA).read_bytes())["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return attributes if isinstance(attributes, dict) else {}


def open_store(place: str) -> PacketStore:
    """The store at a path or, with fsspec, a URL. Raises BadInput for what is no finished store."""
    zarr = library("zarr", f"{place}: a packet store")
    try:
        group = zarr.open_group(place, mode="r")
    except (OSError, ValueError) as error:
        raise BadInput(f"{place}: no packet store can be opened here ({' '.join(str(error).split())})") from None
    attributes = stored_attributes(place, dict(group.attrs))
    if not attributes.complete:
        raise BadInput(f"{place}: was not finished; run `volsplat prepare {attributes.source.name} {place}` again")
    return PacketStore(place, group, attributes)


def stored_attributes(place: str, attributes: dict[str, Any]) -> StoreAttributes:
    """What the attributes of a group tell. Raises BadInput where they are not those of a store of this format."""
    told = attributes.get(ATTRIBUTE)
    if not isinstance(told, dict):
        raise BadInput(f"{place}: is no packet store; make one by `volsplat prepare VOLUME {place}`")
    if told.get("format") != FORMAT:
        raise BadInput(
            f"{place}: is a packet store of format {told.get('format')}, this version reads format {FORMAT}; "
            "prepare the volume again"
        )
    try:
        return StoreAttributes.from_builtins(told)
    except msgspec.ValidationError as error:
        raise BadInput(f"{place}: its attributes are damaged ({error}); prepare the volume again") from None
