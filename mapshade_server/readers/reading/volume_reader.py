"""What every volume reader offers, whatever the format behind it, and what readers need to offer it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, VolumeDescription
from volsplat.protocol.text.byte_sizes import bytes_text
from volsplat.protocol.text.errors import BadInput

Voxels = NDArray[Any]  # shaped (k, j, i), C-contiguous, native byte order, the source's own scalar type
ReadBox = Callable[[Box], Voxels]

# The scalar types that a volume may have, by their torch names, which are numpy's too.
SCALAR_TYPES = tuple(SCALAR_BYTES)

BYTES_BESIDE = 2 << 20  # of what sheets are made of: with less, calls cost more than voxels if sheets are thin


class VolumeReader(Protocol):
    """One opened volume. Its methods raise BadInput if the file turns out to be unusable."""

    @property
    def description(self) -> VolumeDescription:
        """The grid, its place in space and the scalar type."""

    def read(self, box: Box) -> Voxels:
        """The voxels of `box`, which must lie within the grid."""

    @property
    def read_second(self) -> ReadBox | None:
        """As `read`, of a volume whose description has a `second_scalar`; NaN becomes the lowest of its range."""


def read_scalars(reader: VolumeReader, box: Box) -> list[Voxels]:
    """The voxels of `box`, and their second scalar if the volume has one."""
    return [read(box) for read in (reader.read, reader.read_second) if read is not None]


@dataclass(frozen=True)
class OpenedVolume:
    """What each format makes of a file: a description, and a function that gives the voxels of a box."""

    description: VolumeDescription
    read: ReadBox
    found_files: Callable[[], Sequence[VolumeFile]] = tuple  # if they are not what is named: see volume_files
    parts: Sequence[Part] = field(kw_only=True)
    """Of the same file, this one included, that could be named where nobody did; none if there is nothing to choose."""
    read_second: ReadBox | None = field(default=None, kw_only=True)

    @property
    def files(self) -> Sequence[VolumeFile]:
        return self.found_files()


Open = Callable[[Path, str], OpenedVolume]  # given the part that is named, "" for none


@dataclass(frozen=True)
class VolumeFormat:
    """A format of files, one of its reader's FORMATS. `recognises` gets a file's first bytes, unzipped if it is gzip.

    If no format recognises a file, the extension decides among those that have no mark of their own.
    """

    name: str  # with the usual extensions, as messages call it
    open: Open
    recognises: Callable[[bytes], bool] = lambda head: False
    extensions: tuple[str, ...] = ()
    gzip: bool = False  # read also if gzip has packed the file as a whole
    parts: bool = True  # a file may hold several volumes, which its header tells


@dataclass(frozen=True)
class FolderFormat:
    """A format of folders, its reader's FOLDER_FORMAT; the first that recognises one has it."""

    name: str
    open: Open
    recognises: Callable[[Path], bool]


def packed_or_not(*extensions: str) -> tuple[str, ...]:
    """These extensions, and each with that of gzip behind it."""
    return tuple(name + packed for name in extensions for packed in ("", ".gz"))


def boxes_of(whole: Callable[[], Voxels]) -> ReadBox:
    """Reads boxes from all voxels of a volume, which `whole` gives when the first is wanted, and which are kept."""
    kept = cache(whole)
    return lambda box: kept()[box.slices()].copy()


def by_sheets(source: object, scalar_type: str, read: ReadBox, numbers: int = 1) -> ReadBox:
    """Reads boxes of this type as `read` has their voxels, as many sheets at a time as fit into BYTES_BESIDE.

    `numbers` is how many a voxel is made of; they count as float64, which they are reckoned with as.
    """

    def sheets(box: Box) -> Voxels:
        voxels = voxel_room(box, scalar_type, source)
        sheet_bytes = box.size[0] * box.size[1] * numbers * SCALAR_BYTES["float64"]
        for some in box.layers(2, max(1, BYTES_BESIDE // sheet_bytes), box.low[2]):
            voxels[some.slices(box.low)] = read(some)
        return voxels

    return sheets


def voxel_room(box: Box, dtype: DTypeLike, source: object) -> Voxels:
    """Room for the voxels of `box`, shaped (k, j, i). Raises BadInput, naming the `source`, if there is too little."""
    try:
        return np.empty(box.size[::-1], dtype)
    except MemoryError:
        needed = box.voxels * np.dtype(dtype).itemsize
        raise no_room(source, f"{bytes_text(needed)} of voxels") from None


def no_room(source: object, what: str = "the voxels") -> BadInput:
    return BadInput(
        f"{source}: {what} do not fit into this machine's memory; prepare the volume first (volsplat prepare), "
        "or share it among more machines"
    )
