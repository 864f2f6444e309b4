"""NRRD with attached and detached headers (teem.sourceforge.net/nrrd/format.html).

The header is read here and the voxels as they are stored, since SimpleITK (2.5) reads NRRD files whole even if
they are raw and knows no bzip2. Only voxels written as text go through SimpleITK.
"""

import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.medicine.nrrd_header import LONGEST_LINE, NrrdHeader, header_of_file
from volsplat.mapshade_server.readers.medicine.nrrd_kinds import (
    are_volumes,
    kind_of,
    layers_missed,
    refuse_flat_colours,
    volume_names,
)
from volsplat.mapshade_server.readers.medicine.nrrd_place import place_of
from volsplat.mapshade_server.readers.reading.components import (
    ChosenVolume,
    Component,
    are_colours,
    chosen_volume,
)
from volsplat.mapshade_server.readers.reading.grids import refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.header_numbers import numbered_names
from volsplat.mapshade_server.readers.reading.named_files import named_file
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.part_options import chosen_frame
from volsplat.mapshade_server.readers.reading.parts import PartNeeded, numbered
from volsplat.mapshade_server.readers.reading.simple_itk import extracted, header_of
from volsplat.mapshade_server.readers.reading.stored_voxels import (
    BYTE_ORDERS,
    Piece,
    StoredVoxels,
    unpacked_size,
)
from volsplat.mapshade_server.readers.reading.unpacked_stream import Packing
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

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
TEXT_ENCODINGS = ("txt", "text", "ascii", "hex")

LARGEST_FILE = 1 << 62  # bytes
AT_END = -1  # bytes to skip: the voxels are the last of the file
SPATIAL_KINDS = ("domain", "space")
VECTOR_KINDS = ("vector", "2-vector", "3-vector", "4-vector", "covariant-vector", "normal", "3-normal", "3-gradient")
FRAME_KINDS = ("list", "time", "none", "???", "")  # of an axis along which there are volumes, not components


@dataclass(frozen=True)
class _Axes:
    """What the header's axes are: the three of one volume and, if there are several volumes, that along them.

    `frames` volumes lie interleaved, voxel by voxel, or one after the other. Interleaved ones may be the components of
    a `series` of vectors, one after the other.
    """

    sizes: tuple[int, ...]
    of_volume: tuple[int, int, int]
    frames: int
    kind: str  # of the axis along the volumes, "" if the header states none
    interleaved: bool
    series: int = 1

    @property
    def dims(self) -> Index:
        i, j, k = self.of_volume
        return (self.sizes[i], self.sizes[j], self.sizes[k])

    @property
    def stored(self) -> Index:
        """The size of all volumes as one grid: side by side along i if they are interleaved, else along k."""
        ni, nj, nk = self.dims
        return (ni * self.frames, nj, nk * self.series) if self.interleaved else (ni, nj, nk * self.frames)


def open_nrrd(path: Path, part: str = "") -> OpenedVolume:
    """The reader for an NRRD file, and the volume of it that is named if there are several.

    Raises BadInput if the header cannot be used or the data is missing.
    """
    header = header_of_file(path)
    axes = _axes(header)
    stored = _scalar_type(header)
    chosen = _chosen(header, part, axes, stored)
    description = _description(header, axes, chosen, stored)
    encoding = _encoding(header)
    if encoding in TEXT_ENCODINGS:
        return _opened_text(path, header, axes, description)
    if encoding not in PACKINGS:
        raise header.wrong("encoding", "is not one of raw, gzip, bzip2, text, hex")
    return _opened_numbers(header, axes, description, chosen, np.dtype(stored))


def _chosen(header: NrrdHeader, part: str, axes: _Axes, scalar_type: str) -> ChosenVolume:
    """Components of vectors go by their letters, all else by its number. Raises BadInput."""
    path = header.path
    if _is_vector(axes, scalar_type):
        return chosen_volume(path, part, axes.series, axes.frames)
    if axes.series > 1:
        refuse_vectors(path, f"axes of {axes.frames} and {axes.series} values that are not axes of space")
    if axes.frames > 1 and not part and axes.kind not in FRAME_KINDS:
        what = f"{axes.frames} components a voxel, of kind {axes.kind}"
        line = f"{path}: has {what}, volsplat needs one number a voxel; choose one, as in {path}#0"
        raise PartNeeded(line, numbered(axes.frames, "component"))
    frame, name = chosen_frame(path, part, axes.frames, volume_names(header.pairs, axes.frames))
    return ChosenVolume(frame, name, Component(axes.frames, frame), [])


def _is_vector(axes: _Axes, scalar_type: str) -> bool:
    """Colours are none, which ITK calls vectors too; they go by their numbers, as tensors do."""
    return axes.kind in VECTOR_KINDS and not are_colours(axes.frames, scalar_type)


def _value_name(axes: _Axes, component: Component, scalar_type: str) -> str:
    if _is_vector(axes, scalar_type):
        return component.value_name()
    return "" if axes.kind in FRAME_KINDS else f"component {component.number}"


def _scalar_type(header: NrrdHeader) -> str:
    scalar_type = SCALAR_TYPES.get(header.fields.get("type", "").lower())
    if scalar_type is None:
        raise header.wrong("type", "is not a type of number that volsplat reads")
    return scalar_type


def _encoding(header: NrrdHeader) -> str:
    return header.fields.get("encoding", "").lower()


def _description(header: NrrdHeader, axes: _Axes, chosen: ChosenVolume, stored: str) -> VolumeDescription:
    encoding = _encoding(header)
    place = place_of(header, axes.of_volume, axes.dims)
    kind, kind_from, bands = kind_of(header.path, header.pairs, chosen.frame, axes.frames)
    why_whole = "" if encoding == "raw" else f"the voxels are stored as {encoding}"
    return VolumeDescription(
        name=chosen.name,
        format="NRRD",
        geometry=place.geometry,
        scalar_type=chosen.component.scalar_type(stored),
        density_name=_value_name(axes, chosen.component, stored),
        unit=place.unit,
        value_unit=header.fields.get("sample units", "").strip('"'),
        anatomical=place.anatomical,
        warnings=(*place.warnings, *layers_missed(header.pairs, axes.frames)),
        kind=kind,
        kind_from=kind_from,
        bands=bands,
        reads_sub_cubes=not why_whole,
        chunk=(axes.dims[0], 1, 1),
        why_whole=why_whole,
    )


def _opened_text(path: Path, header: NrrdHeader, axes: _Axes, description: VolumeDescription) -> OpenedVolume:
    if axes.frames > 1:
        what = "volumes" if axes.kind in FRAME_KINDS else "components"
        raise BadInput(f"{path}: holds several {what} as text, which volsplat cannot tell apart; save it as binary")
    pieces = _pieces(header, axes.stored, 1, Packing.RAW)
    text = StoredVoxels(path, axes.stored, np.dtype(description.scalar_type), pieces)
    text.check_there()
    return OpenedVolume(
        description, lambda box: extracted(path, header_of(path, "NrrdImageIO"), box), text.files, parts=()
    )


def _opened_numbers(
    header: NrrdHeader, axes: _Axes, description: VolumeDescription, chosen: ChosenVolume, dtype: "np.dtype[Any]"
) -> OpenedVolume:
    path, stored, component = header.path, dtype.name, chosen.component
    order = BYTE_ORDERS.get(header.fields.get("endian", "").lower())
    if order is None and dtype.itemsize > 1:
        raise header.wrong("endian", "is neither little nor big")
    dtype = dtype.newbyteorder(order or "=")
    pieces = _pieces(header, axes.stored, dtype.itemsize, PACKINGS[_encoding(header)])
    voxels = StoredVoxels(path, axes.stored, dtype, pieces)
    voxels.check_files()

    if axes.interleaved:
        start = chosen.frame * axes.dims[2] if axes.series > 1 else 0
        read = component.of_interleaved(path, stored, partial(voxels.read_from, start))
    else:
        apart = [replace(voxels) for _ in component.taken]  # each goes on unpacking where it was
        each = [partial(one.read_from, n * axes.dims[2]) for one, n in zip(apart, component.taken, strict=True)]
        read = component.of_separate(path, stored, each)
    return OpenedVolume(description, read, voxels.files, parts=chosen.parts)


def _axes(header: NrrdHeader) -> _Axes:
    sizes = header.integers("sizes")
    if not sizes or min(sizes) < 1 or header.integers("dimension") != (len(sizes),):
        raise header.wrong("sizes", "does not fit the dimension")
    refuse_flat_colours(header.path, sizes, _kinds(header), placed="space directions" in header.fields)
    leading = _leading(header, len(sizes)) if len(sizes) > 3 else []
    first_three = [one and sum(leading[:n]) < 3 for n, one in enumerate(leading)]  # ITK has a fourth one for a series
    spatial = first_three or [True] * len(sizes)
    all_axes = range(len(sizes))
    # Axes of several values that lead nowhere in space.
    along = [axis for axis in all_axes if sizes[axis] > 1 and not spatial[axis]] if len(sizes) > 3 else []
    axes = [axis for axis in all_axes if axis not in along]
    for axis in reversed(all_axes):
        if axis in axes and sizes[axis] == 1 and len(axes) > 3 and (not spatial[axis] or axis >= 3):
            axes.remove(axis)
    if len(along) > 1 and any(leading[axis] for axis in along):
        refuse_other_dimensions(header.path, sizes)
    kinds = (*_kinds(header), *[""] * len(sizes))
    last, series = len(sizes) - 1, 1
    if (
        along == [0, last]
        and len(axes) == 3
        and kinds[0] in VECTOR_KINDS
        and kinds[last] in FRAME_KINDS + SPATIAL_KINDS
    ):
        series = sizes[along.pop()]
    if len(along) > 1 or along and along[0] not in (0, last):
        told = " and ".join(f"{sizes[axis]}" for axis in along)
        refuse_vectors(header.path, f"axes of {told} values that are not axes of space")
    refuse_other_dimensions(header.path, tuple(sizes[axis] for axis in axes))
    of_volume = (axes[0], axes[1], axes[2])
    if not along:
        return _Axes(sizes, of_volume, 1, "", False)
    kind = "list" if series == 1 and are_volumes(header.pairs) else kinds[along[0]]
    return _Axes(sizes, of_volume, sizes[along[0]], "" if kind in SPATIAL_KINDS else kind, along == [0], series)


def _kinds(header: NrrdHeader) -> list[str]:
    return header.fields.get("kinds", "").lower().split()


def _leading(header: NrrdHeader, count: int) -> list[bool]:
    """Which axes lead through space, as kinds and directions have it; none if the header does not say."""
    kinds = _kinds(header)
    directions = header.vectors("space directions") if "space directions" in header.fields else []
    if len(kinds) != count and len(directions) != count:
        return []
    by_kinds = [kind in SPATIAL_KINDS for kind in kinds] if len(kinds) == count else [True] * count
    leading = [direction is not None for direction in directions] if len(directions) == count else [True] * count
    return [by_kind and leads for by_kind, leads in zip(by_kinds, leading, strict=True)]


def _pieces(header: NrrdHeader, dims: Index, item_bytes: int, packing: Packing) -> tuple[Piece, ...]:
    """The files that hold the voxels, in the order of their sheets."""
    names = _data_files(header, dims[2])
    count = len(names) or 1
    if dims[2] % count:
        raise header.wrong("data file", f"names {count} files for {dims[2]} slices")
    paths = [named_file(header.path, name) for name in names] or [header.path]
    sheets = dims[2] // count
    lines = (header.integers("line skip") or (0,))[0]
    skip = (header.integers("byte skip") or (0,))[0]
    if lines < 0:
        raise header.wrong("line skip", "is less than 0")
    if skip < AT_END:
        raise header.wrong("byte skip", "is less than -1, by which the voxels are the last of the file")
    promised = sheets * dims[0] * dims[1] * item_bytes
    pieces = []
    for path in paths:
        if not path.is_file():
            return (Piece(path, dims[2]),)  # check_files reports it
        offset = _after_lines(path, 0 if names else header.end, lines)
        if packing == Packing.RAW:
            offset = max(path.stat().st_size - promised, 0) if skip == AT_END else offset + skip
            pieces.append(Piece(path, sheets, offset))
        else:
            dropped = unpacked_size(path, offset, packing, LARGEST_FILE) - promised if skip == AT_END else skip
            pieces.append(Piece(path, sheets, offset, packing, dropped))
    return tuple(pieces)


def _data_files(header: NrrdHeader, slices: int) -> list[str]:
    """The names of a detached header's data files: one, a list, or a numbered pattern. Empty if attached."""
    value = header.fields.get("data file", "")
    if header.file_list or value.upper().startswith("LIST"):
        return list(header.file_list)
    words = value.split()
    if len(words) >= 4 and re.search(r"%\d*d", words[0]):
        try:
            return numbered_names(words[0], words[1:4], slices)
        except ValueError as error:
            raise header.wrong("data file", str(error)) from None
    return [value] if value else []


def _after_lines(path: Path, offset: int, lines: int) -> int:
    with opened(path) as file:
        file.seek(offset)
        while lines and (line := file.readline(LONGEST_LINE)):  # or a part of one
            lines -= line.endswith(b"\n")
        return file.tell()


FORMATS = (VolumeFormat("NRRD (.nrrd, .nhdr)", open_nrrd, lambda head: head.startswith(b"NRRD000")),)
