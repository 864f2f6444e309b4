"""CCP4 and MRC maps (.map, .mrc, .ccp4), plain or gzip (ccpem.ac.uk/mrc_format, CCP4's maplib).

The header is read here, so that only the wanted rows are read of the voxels and a wrong byte order stamp is seen
through; gemmi says how the cell's axes lie. i, j, k are the columns, rows and sections as they are stored, whichever
of x, y, z each follows: no voxel is moved, the index-to-physical matrix says it.
"""

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from volsplat.mapshade_server.readers.molecules.map_kinds import is_difference, kind_of_names
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import checked_geometry, refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes
from volsplat.mapshade_server.readers.reading.part_options import chosen_frame
from volsplat.mapshade_server.readers.reading.stored_voxels import one_piece
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, Voxels, packed_or_not
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Box, Geometry, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.text.errors import BadInput

HEADER_BYTES = 1024
UNIT = "Å"

# Words of four bytes, counted from 1 as the format's documents do.
SIZES, MODE, STARTS, INTERVALS, LENGTHS, ANGLES, AXES, LEAST = 1, 4, 5, 8, 11, 14, 17, 20
SPACE_GROUP, EXTENDED_BYTES, SKEWED, IMOD_STAMP, IMOD_FLAGS, ORIGIN, MACHINE_STAMP = 23, 24, 25, 39, 40, 50, 54
MEAN, DEVIATION, LABELS = 22, 55, 57
LABEL_BYTES = 80

SCALAR_TYPES = {0: "int8", 1: "int16", 2: "float32", 6: "uint16", 12: "float16"}
COLOUR_MODES = (16,)
COMPLEX_MODES = (3, 4)
BYTE_ORDERS: dict[Literal["<", ">"], bytes] = {"<": b"\x44", ">": b"\x11"}  # with their machine stamps
IMOD = 1146047817
IMOD_SIGNED = 1

MOST_VOXELS_ASIDE = 1 << 20
FLATTEST_CELL = 1e-3  # its volume, of that of a right-angled cell
IMAGE_STACK = 0  # these are space groups
VOLUME_STACKS = range(401, 631)
SAME_PLACE = 0.5  # of a step: how far the two statements of the origin may differ


@dataclass(frozen=True)
class _Header:
    """The header's words in the file's byte order."""

    path: Path
    raw: bytes
    order: Literal["<", ">"]

    def integers(self, word: int, count: int = 3) -> tuple[int, ...]:
        return struct.unpack_from(f"{self.order}{count}i", self.raw, 4 * (word - 1))

    def integer(self, word: int) -> int:
        return self.integers(word, 1)[0]

    def numbers(self, word: int, count: int = 3) -> tuple[float, ...]:
        return struct.unpack_from(f"{self.order}{count}f", self.raw, 4 * (word - 1))

    @property
    def labels(self) -> list[str]:
        """What programs wrote about the map."""
        raw = self.raw[4 * (LABELS - 1) :]
        texts = (raw[at : at + LABEL_BYTES].partition(b"\0")[0] for at in range(0, len(raw), LABEL_BYTES))
        return [text for text in (one.decode("latin-1").strip() for one in texts) if text]

    def wrong(self, what: str, values: tuple[float, ...]) -> BadInput:
        shown = " ".join(f"{value:g}" for value in values)
        return BadInput(f"{self.path}: the map's {what} ({shown}) cannot be used; correct the header")


def open_density_map(path: Path, part: str) -> OpenedVolume:
    """The reader for a map; `part` is the number of a volume in a stack of them. Raises BadInput."""
    header = _header_of(path)
    dims, skipped_sheets = _volume(header, part)
    stored_type = _stored_type(header)
    first_voxel = HEADER_BYTES + header.integer(EXTENDED_BYTES)
    if first_voxel < HEADER_BYTES:
        raise header.wrong("length of the extended header", (first_voxel - HEADER_BYTES,))
    first_voxel += skipped_sheets * dims[0] * dims[1] * stored_type.itemsize
    voxels = one_piece(path, dims, stored_type, first_voxel)
    geometry, unit, warnings = _place(header, dims)
    kind, kind_from = _kind(header)
    description = VolumeDescription(
        name=path.name,
        format="CCP4/MRC map" + (f", volume {part} of a stack" if part else ""),
        geometry=geometry,
        scalar_type="float32" if stored_type.kind == "f" else stored_type.name,
        unit=unit,
        warnings=warnings,
        kind=kind,
        kind_from=kind_from,
        up="+z",
        **voxels.access,
    )

    def read(box: Box) -> Voxels:  # half floats are widened
        return voxels.read(box).astype(description.scalar_type, copy=False)

    return OpenedVolume(description, read, parts=())


def _header_of(path: Path) -> _Header:
    raw = first_bytes(path, HEADER_BYTES)
    if len(raw) < HEADER_BYTES:
        raise BadInput(f"{path}: the map's header is truncated; fetch the file again")
    for order in BYTE_ORDERS:
        header = _Header(path, raw, order)
        sizes, axes = header.integers(SIZES), header.integers(AXES)
        if 1 <= min(sizes) <= max(sizes) <= MOST_VOXELS_ASIDE and sorted(axes) in ([0, 0, 0], [1, 2, 3]):
            return header
    raise BadInput(
        f"{path}: is no CCP4 or MRC map, or a damaged one: its sizes and axis order make no sense in either byte "
        "order; fetch or export the map again"
    )


def _volume(header: _Header, part: str) -> tuple[Index, int]:
    """The sizes of the volume, and how many sheets of a stack of volumes lie before it."""
    columns, rows, sections = header.integers(SIZES)
    space_group = header.integer(SPACE_GROUP)
    if space_group == IMAGE_STACK and sections == 1:
        refuse_other_dimensions(header.path, (columns, rows))
    sheets = header.integer(INTERVALS + 2)
    if space_group not in VOLUME_STACKS or not 0 < sheets < sections:
        sheets = sections
    if sections % sheets:
        raise header.wrong("number of sections in a stack of volumes", (sections, sheets))
    return (columns, rows, sheets), chosen_frame(header.path, part, sections // sheets).number * sheets


def _stored_type(header: _Header) -> np.dtype[np.generic]:
    mode = header.integer(MODE)
    if mode in COMPLEX_MODES:
        refuse_vectors(header.path, f"complex numbers (mode {mode}), the transform of a map")
    if mode in COLOUR_MODES:
        refuse_vectors(header.path, f"three colours a voxel (mode {mode})")
    if mode not in SCALAR_TYPES:
        raise BadInput(
            f"{header.path}: voxels of mode {mode} are not read, only those of modes 0, 1, 2, 6 and 12; "
            "convert the map to mode 2 (float32)"
        )
    unsigned = mode == 0 and _has_unsigned_bytes(header)
    return np.dtype("uint8" if unsigned else SCALAR_TYPES[mode]).newbyteorder(header.order)


def _has_unsigned_bytes(header: _Header) -> bool:
    """Whether bytes are meant unsigned, as they were before 2014: IMOD says so, others show it by their range."""
    if header.integer(IMOD_STAMP) == IMOD:
        return not header.integer(IMOD_FLAGS) & IMOD_SIGNED
    least, greatest = header.numbers(LEAST, 2)
    return least >= 0 and 127 < greatest <= 255


def _kind(header: _Header) -> tuple[Kind, str]:
    """What the map is of, and what states it: its label or name, else its space group and statistics."""
    kind, name = kind_of_names([*header.labels, header.path.name])
    if kind != Kind.UNKNOWN:
        return kind, f"it says “{name}”"
    group = header.integer(SPACE_GROUP)
    if group <= 1 or group in VOLUME_STACKS:
        return Kind.EM_MAP, f"its space group {group}, that of a single particle"
    statistics = (*header.numbers(LEAST, 2), *header.numbers(MEAN, 1), *header.numbers(DEVIATION, 1))
    if is_difference(*statistics):
        return Kind.DIFFERENCE_MAP, f"its header: {statistics[0]:.3g} to {statistics[1]:.3g}, as deep as high"
    return Kind.CRYSTAL_MAP, f"its space group {group}"


def _place(header: _Header, dims: Index) -> tuple[Geometry, str, tuple[str, ...]]:
    """The map's place in space, the unit of lengths, and what had to be guessed."""
    warnings = _doubts(header)
    columns, unit = _steps(header, dims, warnings)
    matrix = matrices.transposed(columns)
    starts = header.integers(STARTS)
    origin = matrices.applied(matrix, (float(starts[0]), float(starts[1]), float(starts[2])))
    x, y, z = stated = header.numbers(ORIGIN)
    if any(stated) and all(math.isfinite(number) for number in stated):
        away = matrices.length(matrices.minus((x, y, z), origin))
        if any(starts) and away > SAME_PLACE * matrices.length(columns[0]):
            warnings.append(f"the header places the map twice; its origin {stated} was taken, not its start {starts}")
        origin = (x, y, z)
    return checked_geometry(header.path, dims, matrix, origin), unit, tuple(warnings)


def _doubts(header: _Header) -> list[str]:
    doubts = []
    stamp = header.raw[4 * (MACHINE_STAMP - 1)]
    if any(stamp == other[0] for order, other in BYTE_ORDERS.items() if order != header.order):
        doubts.append("the header's stamp tells the other byte order than its numbers have; the numbers were believed")
    if header.integer(SPACE_GROUP) == IMAGE_STACK:
        doubts.append("the header says that this is a stack of images (space group 0); it is shown as one volume")
    if header.integer(SKEWED) == 1:
        doubts.append("the header's skew transformation (LSKFLG 1) is not applied")
    return doubts


def _steps(header: _Header, dims: Index, warnings: list[str]) -> tuple[Matrix, str]:
    """The physical steps along i, j, k, and their unit: none if the header states no cell."""
    axes = [axis - 1 for axis in header.integers(AXES)]  # which of x, y, z the grid's axes follow
    if axes == [-1, -1, -1]:
        axes = [0, 1, 2]
    lengths, angles, intervals = header.numbers(LENGTHS), header.numbers(ANGLES), header.integers(INTERVALS)
    if not any(lengths):
        warnings.append("the header states no cell; voxels are taken as cubes, without a unit")
        return (IDENTITY[axes[0]], IDENTITY[axes[1]], IDENTITY[axes[2]]), ""
    if not any(angles):
        warnings.append("the header states no angles of the cell; they are taken as 90 degrees")
        angles = (90.0, 90.0, 90.0)
    if not any(intervals):
        warnings.append("the header states no sampling of the cell; the map is taken to fill it")
        intervals = tuple(dims[axes.index(axis)] for axis in range(3))
    if not all(0 < length < math.inf for length in lengths):
        raise header.wrong("cell lengths", lengths)
    if not all(0 < angle < 180 for angle in angles):
        raise header.wrong("cell angles", angles)
    if min(intervals) < 1:
        raise header.wrong("sampling of the cell", intervals)
    cell = library("gemmi", "a CCP4 or MRC map").UnitCell(*lengths, *angles)
    if not cell.volume > FLATTEST_CELL * math.prod(lengths):
        raise header.wrong("cell angles", angles)
    to_physical: Matrix = cell.orth.mat.tolist()
    i, j, k = (matrices.scaled(matrices.column(to_physical, axis), 1.0 / intervals[axis]) for axis in axes)
    return (i, j, k), UNIT


FORMATS = (
    VolumeFormat(
        "CCP4/MRC map (.map, .mrc)",
        open_density_map,
        lambda head: head[208:211] == b"MAP",
        packed_or_not(".mrc", ".mrcs", ".map", ".ccp4"),  # files from before 2000 have no mark
        gzip=True,
    ),
)
