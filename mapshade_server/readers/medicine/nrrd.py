"""NRRD with attached and detached headers (teem.sourceforge.net/nrrd/format.html).

The header is read here and the voxels as they are stored, since SimpleITK (2.5) reads NRRD files whole even where
they are raw and knows no bzip2. Only voxels written as text go through SimpleITK.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from volsplat.mapshade_server.readers.frames import chosen_frame
from volsplat.mapshade_server.readers.simple_itk import (
    checked_geometry,
    extracted,
    header_of,
    refuse_other_dimensions,
    refuse_vectors,
)
from volsplat.mapshade_server.readers.stored_voxels import Packing, Piece, StoredVoxels, unpacked_size
from volsplat.mapshade_server.readers.volume_reader import Voxels
from volsplat.protocol.errors import BadInput
from volsplat.protocol.matrices import IDENTITY, Matrix, Vector, transposed
from volsplat.protocol.volume import Box, Geometry, Index, VolumeDescription

LONGEST_HEADER = 1 << 20
LONGEST_LINE = 1 << 16

_SCALAR_TYPES = {
    "int8": "signed char, int8, int8_t",
    "uint8": "uchar, unsigned char, uint8, uint8_t",
    "int16": "short, short int, signed short, signed short int, int16, int16_t",
    "uint16": "ushort, unsigned short, unsigned short int, uint16, uint16_t",
    "int32": "int, signed int, int32, int32_t",
    "uint32": "uint, unsigned int, uint32, uint32_t",
    "int64": "longlong, long long, long long int, signed long long, signed long long int, int64, int64_t",
    "uint64": "ulonglong, unsigned long long, unsigned long long int, uint64, uint64_t",
    "float32": "float",
    "float64": "double",
}
SCALAR_TYPES = {spelling: name for name, all_ in _SCALAR_TYPES.items() for spelling in all_.split(", ")}

PACKINGS = {
    "raw": Packing.RAW,
    "gz": Packing.DEFLATE,
    "gzip": Packing.DEFLATE,
    "bz2": Packing.BZIP2,
    "bzip2": Packing.BZIP2,
}
BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"little": "<", "big": ">"}
TEXT_ENCODINGS = ("txt", "text", "ascii", "hex")

# Signs that turn an anatomical space into left, posterior, superior.
ANATOMICAL_SPACES: dict[str, Vector] = {
    "right-anterior-superior": (-1.0, -1.0, 1.0),
    "ras": (-1.0, -1.0, 1.0),
    "left-anterior-superior": (1.0, -1.0, 1.0),
    "las": (1.0, -1.0, 1.0),
    "left-posterior-superior": (1.0, 1.0, 1.0),
    "lps": (1.0, 1.0, 1.0),
}
SPATIAL_KINDS = ("domain", "space")
FRAME_KINDS = ("list", "time", "none", "???", "")  # of an axis along which there are volumes, not components


def recognises(head: bytes) -> bool:
    return head.startswith(b"NRRD000")


@dataclass(frozen=True)
class _Header:
    """The fields by their lower-case names, and where the header ends in the file."""

    path: Path
    fields: dict[str, str]
    file_list: tuple[str, ...]
    end: int

    def wrong(self, name: str, why: str) -> BadInput:
        return BadInput(f'{self.path}: the header\'s "{name}: {self.fields.get(name, "")}" {why}; correct the header')

    def integers(self, name: str) -> tuple[int, ...]:
        try:
            return tuple(int(word) for word in self.fields.get(name, "").split())
        except ValueError:
            raise self.wrong(name, "is not a list of whole numbers") from None

    def numbers(self, name: str, count: int) -> list[float]:
        try:
            values = [float(word) for word in self.fields[name].split()]
        except ValueError:
            raise self.wrong(name, "is not a list of numbers") from None
        if len(values) != count:
            raise self.wrong(name, f"should have {count} values")
        return values

    def vectors(self, name: str) -> list[Vector | None]:
        """Vectors of three components, or None for an axis that leads nowhere in space: none, or along time only."""
        found: list[Vector | None] = []
        for match in re.finditer(r"none|\(([^()]*)\)", self.fields[name]):
            try:
                values = [float(word) for word in (match[1] or "").split(",") if word.strip()]
            except ValueError:
                raise self.wrong(name, "is not a list of vectors") from None
            if match[0] == "none" or len(values) > 3 and not any(values[:3]) and any(values[3:]):
                found.append(None)
            elif len(values) < 3 or any(values[3:]):
                raise self.wrong(name, "should have three components in each vector")
            else:
                found.append((values[0], values[1], values[2]))
        return found


@dataclass(frozen=True)
class _Axes:
    """What the header's axes are: the three of one volume and, where there are several volumes, that along them.

    `frames` volumes lie interleaved, voxel by voxel, or one after the other.
    """

    sizes: tuple[int, ...]
    of_volume: tuple[int, int, int]
    frames: int
    kind: str  # of the axis along the volumes, "" where the header states none
    interleaved: bool

    @property
    def dims(self) -> Index:
        i, j, k = self.of_volume
        return (self.sizes[i], self.sizes[j], self.sizes[k])

    @property
    def stored(self) -> Index:
        """The size of all volumes as one grid: side by side along i where they are interleaved, else along k."""
        ni, nj, nk = self.dims
        return (ni * self.frames, nj, nk) if self.interleaved else (ni, nj, nk * self.frames)


class NrrdReader:
    """One volume of an NRRD file whose voxels are raw, gzip or bzip2."""

    def __init__(self, description: VolumeDescription, voxels: StoredVoxels, axes: _Axes, frame: int) -> None:
        self._description = description
        self._voxels = voxels
        self._axes = axes
        self._frame = frame

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        (i0, j0, k0), (i1, j1, k1) = box
        if self._axes.interleaved:
            frames = self._axes.frames
            every = self._voxels.read(Box((i0 * frames, j0, k0), (i1 * frames, j1, k1)))
            return every[:, :, self._frame :: frames].copy()
        before = self._frame * self._axes.dims[2]
        return self._voxels.read(Box((i0, j0, before + k0), (i1, j1, before + k1)))


class TextNrrdReader:
    """One NRRD volume whose voxels are written as text."""

    def __init__(self, path: Path, description: VolumeDescription) -> None:
        self._path = path
        self._description = description

    def describe(self) -> VolumeDescription:
        return self._description

    def read(self, box: Box) -> Voxels:
        return extracted(self._path, header_of(self._path, "NrrdImageIO"), box)


def open_nrrd(path: Path, part: str = "") -> NrrdReader | TextNrrdReader:
    """The reader for an NRRD file, and the volume of it that is named where there are several.

    Raises BadInput where the header cannot be used or the data is missing.
    """
    header = _header_of(path)
    axes = _axes(header)
    if axes.frames > 1 and not part and axes.kind not in FRAME_KINDS:
        what = f"{axes.frames} components a voxel, of kind {axes.kind}"
        raise BadInput(f"{path}: has {what}, volsplat needs one number a voxel; choose one, as in {path}#0")
    frame = chosen_frame(path, part, axes.frames)
    scalar_type = SCALAR_TYPES.get(header.fields.get("type", "").lower())
    if scalar_type is None:
        raise header.wrong("type", "is not a type of number that volsplat reads")
    encoding = header.fields.get("encoding", "").lower()
    geometry, anatomical = _geometry(header, axes)
    why_whole = "" if encoding == "raw" else f"the voxels are stored as {encoding}"
    description = VolumeDescription(
        name=f"{path.name}#{frame}" if axes.frames > 1 else path.name,
        format="NRRD",
        geometry=geometry,
        scalar_type=scalar_type,
        unit=_unit(header, anatomical),
        anatomical=anatomical,
        reads_sub_cubes=not why_whole,
        why_whole=why_whole,
    )
    if encoding in TEXT_ENCODINGS:
        if axes.frames > 1:
            raise header.wrong("encoding", "holds several volumes as text, which volsplat cannot tell apart")
        return TextNrrdReader(path, description)
    if encoding not in PACKINGS:
        raise header.wrong("encoding", "is not one of raw, gzip, bzip2, text, hex")
    order = BYTE_ORDERS.get(header.fields.get("endian", "").lower())
    if order is None and np.dtype(scalar_type).itemsize > 1:
        raise header.wrong("endian", "is neither little nor big")
    voxels = StoredVoxels(
        source=path,
        dims=axes.stored,
        dtype=np.dtype(scalar_type).newbyteorder(order or "="),
        pieces=_pieces(header, axes.stored, np.dtype(scalar_type).itemsize, PACKINGS[encoding]),
    )
    voxels.check_files()
    return NrrdReader(description, voxels, axes, frame)


def _header_of(path: Path) -> _Header:
    fields: dict[str, str] = {}
    file_list: list[str] = []
    with path.open("rb") as file:
        file.readline(LONGEST_LINE)  # the magic, which was recognised
        while (line := file.readline(LONGEST_LINE)).strip():
            text = line.decode("utf-8", "replace").strip()
            if fields.get("data file", "").upper().startswith("LIST"):
                file_list.append(text)
            elif not text.startswith("#") and ":=" not in text and ":" in text:
                name, _, value = text.partition(":")
                fields["data file" if name == "datafile" else name.strip().lower()] = value.strip()
            if file.tell() > LONGEST_HEADER:
                raise BadInput(f"{path}: the NRRD header does not end; correct the file")
        return _Header(path, fields, tuple(file_list), file.tell())


def _axes(header: _Header) -> _Axes:
    sizes = header.integers("sizes")
    if not sizes or min(sizes) < 1 or header.integers("dimension") != (len(sizes),):
        raise header.wrong("sizes", "does not fit the dimension")
    spatial = _spatial(header, len(sizes))
    all_axes = range(len(sizes))
    # Axes of several values that lead nowhere in space.
    along = [axis for axis in all_axes if sizes[axis] > 1 and not spatial[axis]] if len(sizes) > 3 else []
    axes = [axis for axis in all_axes if axis not in along]
    for axis in reversed(all_axes):
        if axis in axes and sizes[axis] == 1 and len(axes) > 3 and (not spatial[axis] or axis >= 3):
            axes.remove(axis)
    if len(along) > 1 or along and along[0] not in (0, len(sizes) - 1):
        told = " and ".join(f"{sizes[axis]}" for axis in along)
        refuse_vectors(header.path, f"axes of {told} values that are not axes of space")
    refuse_other_dimensions(header.path, tuple(sizes[axis] for axis in axes))
    of_volume = (axes[0], axes[1], axes[2])
    if not along:
        return _Axes(sizes, of_volume, 1, "", False)
    kind = (*_kinds(header), *[""] * len(sizes))[along[0]]
    return _Axes(sizes, of_volume, sizes[along[0]], kind, along == [0])


def _kinds(header: _Header) -> list[str]:
    return header.fields.get("kinds", "").lower().split()


def _spatial(header: _Header, count: int) -> list[bool]:
    """Which axes lead through space, as the kinds have it or else the directions."""
    kinds = _kinds(header)
    if len(kinds) == count:
        return [kind in SPATIAL_KINDS for kind in kinds]
    directions = header.vectors("space directions") if "space directions" in header.fields else []
    return [direction is not None for direction in directions] if len(directions) == count else [True] * count


def _geometry(header: _Header, axes: _Axes) -> tuple[Geometry, bool]:
    """The place in space, with physical axes turned to LPS where the file names an anatomical space."""
    space = header.fields.get("space", "").lower().removesuffix("-time")
    anatomical = space in ANATOMICAL_SPACES
    signs = ANATOMICAL_SPACES.get(space, (1.0, 1.0, 1.0))
    count = len(axes.sizes)
    matrix: Matrix = IDENTITY
    origin: Vector = (0.0, 0.0, 0.0)
    if "space directions" in header.fields:
        directions = header.vectors("space directions")
        steps = [directions[axis] for axis in axes.of_volume] if len(directions) == count else []
        if len(steps) != 3 or None in steps:
            raise header.wrong("space directions", "does not give a vector for each axis of the volume")
        matrix = transposed((steps[0] or origin, steps[1] or origin, steps[2] or origin))
    else:
        lengths, starts = _axis_positions(header, axes)
        matrix = ((lengths[0], 0.0, 0.0), (0.0, lengths[1], 0.0), (0.0, 0.0, lengths[2]))
        origin = (starts[0], starts[1], starts[2])
        anatomical = False  # spacings alone place nothing in the space
        signs = (1.0, 1.0, 1.0)
    if "space origin" in header.fields:
        origins = header.vectors("space origin")
        if len(origins) != 1 or origins[0] is None:
            raise header.wrong("space origin", "is not one vector")
        origin = origins[0]
    turned = tuple(tuple(sign * x for x in row) for sign, row in zip(signs, matrix, strict=True))
    placed = tuple(sign * x for sign, x in zip(signs, origin, strict=True))
    return checked_geometry(header.path, axes.dims, turned, placed), anatomical  # type: ignore[arg-type]


def _axis_positions(header: _Header, axes: _Axes) -> tuple[list[float], list[float]]:
    """Spacing and start of each axis from spacings and axis mins, which say nothing (NaN) or are 1 and 0."""
    lengths, starts = [1.0] * 3, [0.0] * 3
    for name, values in (("spacings", lengths), ("axis mins", starts)):
        if name in header.fields:
            given = header.numbers(name, len(axes.sizes))
            for n, axis in enumerate(axes.of_volume):
                if given[axis] == given[axis]:
                    values[n] = given[axis]
    return lengths, starts


def _unit(header: _Header, anatomical: bool) -> str:
    units = re.findall(r'"([^"]*)"', header.fields.get("space units", header.fields.get("units", "")))
    if units:
        return str(units[0])
    return "mm" if anatomical else ""  # what all writers of anatomical spaces mean


def _pieces(header: _Header, dims: Index, item_bytes: int, packing: Packing) -> tuple[Piece, ...]:
    """The files that hold the voxels, in the order of their sheets."""
    names = _data_files(header)
    paths = [header.path.parent / name for name in names] or [header.path]
    if dims[2] % len(paths):
        raise header.wrong("data file", f"names {len(paths)} files for {dims[2]} slices")
    sheets = dims[2] // len(paths)
    lines = (header.integers("line skip") or (0,))[0]
    skip = (header.integers("byte skip") or (0,))[0]
    promised = sheets * dims[0] * dims[1] * item_bytes
    pieces = []
    for path in paths:
        if not path.is_file():
            return (Piece(path, dims[2]),)  # check_files tells of it
        offset = _after_lines(path, 0 if names else header.end, lines)
        if packing == Packing.RAW:
            offset = max(path.stat().st_size - promised, 0) if skip == -1 else offset + skip
            pieces.append(Piece(path, sheets, offset))
        else:
            dropped = unpacked_size(path, offset, packing) - promised if skip == -1 else skip
            pieces.append(Piece(path, sheets, offset, packing, dropped))
    return tuple(pieces)


def _data_files(header: _Header) -> list[str]:
    """The names of a detached header's data files: one, a list, or a numbered pattern. Empty if attached."""
    value = header.fields.get("data file", "")
    if header.file_list or value.upper().startswith("LIST"):
        return list(header.file_list)
    words = value.split()
    if len(words) >= 4 and re.search(r"%\d*d", words[0]):
        low, high, step = (int(word) for word in words[1:4])
        if step == 0:
            raise header.wrong("data file", "has a step of 0")
        return [words[0] % number for number in range(low, high + (1 if step > 0 else -1), step)]
    return [value] if value else []


def _after_lines(path: Path, offset: int, lines: int) -> int:
    with path.open("rb") as file:
        file.seek(offset)
        for _ in range(lines):
            file.readline()
        return file.tell()
