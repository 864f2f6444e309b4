"""NIfTI-1 and NIfTI-2, plain or gzip, also as .hdr and .img (nifti.nimh.nih.gov).

The header is read here because SimpleITK refuses or straightens a sheared sform, and reads truncated files
without a word. The sform counts where its code is set, else the qform, else the spacing alone.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from volsplat.mapshade_server.readers.medicine.modality import kind_beside
from volsplat.mapshade_server.readers.reading.frames import chosen_frame
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes, is_gzip
from volsplat.mapshade_server.readers.reading.simple_itk import (
    checked_geometry,
    refuse_other_dimensions,
    refuse_vectors,
)
from volsplat.mapshade_server.readers.reading.stored_voxels import Packing, Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_files import DiskFile
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.text.errors import BadInput

HEADER_BYTES = {1: 348, 2: 540}
MAGICS = {1: (b"n+1\0", b"ni1\0"), 2: (b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n")}
LARGEST_OFFSET = 1 << 40
SCALAR_TYPES = {
    2: "uint8",
    4: "int16",
    8: "int32",
    16: "float32",
    64: "float64",
    256: "int8",
    512: "uint16",
    768: "uint32",
    1024: "int64",
    1280: "uint64",
}
INTENT_LABEL = 1002
INTENT_STATISTICS = range(2, 25)  # the distributions of tests, from a correlation to the logarithm of a p-value
BYTE_ORDERS: tuple[Literal["<", ">"], ...] = ("<", ">")
NO_SIDES = "the file states neither sform nor qform: left and right cannot be told"
OTHER_HAND = "its sform and qform disagree on what is left and what is right; the sform is followed"
MILLIMETRES_PER_UNIT = {1: 1000.0, 2: 1.0, 3: 0.001}

_NIFTI_1 = {
    "dim": (40, "i2", 8),
    "intent": (68, "i2", 1),
    "datatype": (70, "i2", 1),
    "pixdim": (76, "f4", 8),
    "vox_offset": (108, "f4", 1),
    "scl": (112, "f4", 2),
    "units": (123, "u1", 1),
    "codes": (252, "i2", 2),
    "quatern": (256, "f4", 6),
    "srow": (280, "f4", 12),
}
_NIFTI_2 = {
    "dim": (16, "i8", 8),
    "datatype": (12, "i2", 1),
    "pixdim": (104, "f8", 8),
    "vox_offset": (168, "i8", 1),
    "scl": (176, "f8", 2),
    "units": (500, "i4", 1),
    "intent": (504, "i4", 1),
    "codes": (344, "i4", 2),
    "quatern": (352, "f8", 6),
    "srow": (400, "f8", 12),
}


def recognises(head: bytes) -> bool:
    return head[344:348] in MAGICS[1] or head[4:12] in MAGICS[2]


@dataclass(frozen=True)
class _Header:
    """The header's bytes, its version and byte order."""

    raw: bytes
    version: int
    order: Literal["<", ">"]

    def values(self, name: str) -> list[float]:
        offset, kind, count = (_NIFTI_1 if self.version == 1 else _NIFTI_2)[name]
        numbers: list[float] = np.frombuffer(self.raw, np.dtype(kind).newbyteorder(self.order), count, offset).tolist()
        return numbers


class NiftiReader:
    """One NIfTI volume. Values are scaled by the header's slope and intercept, as float32 or float64."""

    def __init__(self, description: VolumeDescription, voxels: StoredVoxels, slope: float, intercept: float) -> None:
        self._description = description
        self._voxels = voxels
        self._slope = slope
        self._intercept = intercept

    def describe(self) -> VolumeDescription:
        return self._description

    @property
    def files(self) -> tuple[DiskFile, ...]:
        return self._voxels.files

    def read(self, box: Box) -> Voxels:
        stored = self._voxels.read(box)
        if (self._slope, self._intercept) == (1.0, 0.0):
            return stored
        return (stored.astype(np.float64) * self._slope + self._intercept).astype(self._description.scalar_type)


def open_nifti(path: Path, part: str = "") -> NiftiReader:
    """The reader for a NIfTI file, and the frame of it that is named where there are several.

    Raises BadInput where the header cannot be used or promises too much.
    """
    header = _header_of(path)
    dims, frames = _dims(path, header)
    frame = chosen_frame(path, part, frames)
    code = int(header.values("datatype")[0])
    if code not in SCALAR_TYPES:
        refuse_vectors(path, f"voxels of NIfTI's type {code}, no plain number")
    stored_type = np.dtype(SCALAR_TYPES[code])
    slope, intercept = header.values("scl")
    if slope == 0.0 or not (math.isfinite(slope) and math.isfinite(intercept)):
        slope, intercept = 1.0, 0.0
    scaled = (slope, intercept) != (1.0, 0.0)
    scaled_type = "float32" if stored_type.itemsize <= 2 or stored_type == np.float32 else "float64"
    data, packing = _data_file(path, header)
    start = header.values("vox_offset")[0]
    if not 0 <= start <= LARGEST_OFFSET:
        raise BadInput(f"{path}: the NIfTI header's vox_offset {start} makes no sense; correct the header")
    offset = int(start) + frame * math.prod(dims) * stored_type.itemsize
    raw = packing == Packing.RAW
    voxels = StoredVoxels(
        source=path,
        dims=dims,
        dtype=stored_type.newbyteorder(header.order),
        pieces=(Piece(data, dims[2], offset if raw else 0, packing, 0 if raw else offset),),
    )
    voxels.check_files()
    matrix, origin, anatomical, told = _place(header)
    unit_code = int(header.values("units")[0]) & 7
    kind, kind_from = _kind(path, header)
    to_millimetres = MILLIMETRES_PER_UNIT.get(unit_code, 1.0)
    description = VolumeDescription(
        name=f"{path.name}#{frame}" if frames > 1 else path.name,
        format=f"NIfTI-{header.version}",
        geometry=checked_geometry(
            path, dims, matrices.times(matrix, to_millimetres), matrices.scaled(origin, to_millimetres)
        ),
        scalar_type=scaled_type if scaled else stored_type.name,
        unit="mm" if unit_code in MILLIMETRES_PER_UNIT else "",
        anatomical=anatomical,
        warnings=told,
        kind=kind,
        kind_from=kind_from,
        reads_sub_cubes=raw,
        chunk=voxels.chunk,
        why_whole="" if raw else "the file is compressed by gzip",
    )
    return NiftiReader(description, voxels, slope, intercept)


def _kind(path: Path, header: _Header) -> tuple[Kind, str]:
    intent = int(header.values("intent")[0])
    if intent == INTENT_LABEL:
        return Kind.LABELS, f"its intent {intent}, labels"
    if intent in INTENT_STATISTICS:
        return Kind.STATISTIC_MAP, f"its intent {intent}, a test's statistic"
    return kind_beside(path)


def _header_of(path: Path) -> _Header:
    raw = first_bytes(path, HEADER_BYTES[2])
    for version, size in HEADER_BYTES.items():
        for order in BYTE_ORDERS:
            if len(raw) >= size and int.from_bytes(raw[:4], "little" if order == "<" else "big") == size:
                return _Header(raw, version, order)
    raise BadInput(f"{path}: the NIfTI header is truncated or its size field is wrong; fetch the file again")


def _dims(path: Path, header: _Header) -> tuple[Index, int]:
    """The size of one volume, and how many there are one after the other."""
    count, *sizes = (int(n) for n in header.values("dim"))
    if not 1 <= count <= 7 or min(sizes[:count]) < 1:
        raise BadInput(f"{path}: the NIfTI header's dim {[count, *sizes]} makes no sense; correct the header")
    if count >= 5 and sizes[4] > 1:
        refuse_vectors(path, f"{sizes[4]} components a voxel")
    frames = sizes[3] if count >= 4 else 1
    refuse_other_dimensions(path, (*sizes[: min(count, 3)], *sizes[4:count]))
    return (sizes[0], sizes[1], sizes[2]), frames


def _data_file(path: Path, header: _Header) -> tuple[Path, Packing]:
    """The file with the voxels: the header's own, or the .img beside a .hdr."""
    magic = header.raw[344:348] if header.version == 1 else header.raw[4:8]
    return image_beside(path) if magic.startswith(b"ni") else (path, _packing(path))


def image_beside(path: Path) -> tuple[Path, Packing]:
    """The .img that belongs to a .hdr, whether it is there or not, and how it is packed."""
    header = path.with_name(path.name.removesuffix(".gz"))
    image = header.with_suffix(".IMG" if header.suffix.isupper() else ".img")
    zipped = image.with_name(image.name + ".gz")
    data = zipped if zipped.is_file() and not image.is_file() else image
    return data, _packing(data)


def _packing(path: Path) -> Packing:
    return Packing.DEFLATE if path.is_file() and is_gzip(path) else Packing.RAW


def _place(header: _Header) -> tuple[Matrix, Vector, bool, tuple[str, ...]]:
    """Index-to-physical matrix and origin in LPS, whether the file states them in patient space, and what to tell."""
    qform, sform = (int(code) for code in header.values("codes"))
    if qform <= 0 and sform <= 0:
        di, dj, dk = _spacing(header)
        return ((di, 0.0, 0.0), (0.0, dj, 0.0), (0.0, 0.0, dk)), (0.0, 0.0, 0.0), False, (NO_SIDES,)
    matrix, origin = _sform(header) if sform > 0 else _qform(header)
    told: tuple[str, ...] = ()
    if qform > 0 and sform > 0 and matrices.determinant(matrix) * matrices.determinant(_qform(header)[0]) < 0:
        told = (OTHER_HAND,)
    return matrix, origin, True, told


def _sform(header: _Header) -> tuple[Matrix, Vector]:
    s = header.values("srow")
    return _lps(((s[0], s[1], s[2]), (s[4], s[5], s[6]), (s[8], s[9], s[10]))), (-s[3], -s[7], s[11])


def _qform(header: _Header) -> tuple[Matrix, Vector]:
    di, dj, dk = _spacing(header)
    b, c, d, x, y, z = header.values("quatern")
    a = math.sqrt(max(0.0, 1.0 - (b * b + c * c + d * d)))
    turned = matrices.rotation_from_quaternion((b, c, d, a))
    dk = -dk if header.values("pixdim")[0] < 0 else dk
    rows: Matrix = tuple((row[0] * di, row[1] * dj, row[2] * dk) for row in turned)  # type: ignore[assignment]
    return _lps(rows), (-x, -y, z)


def _spacing(header: _Header) -> Vector:
    di, dj, dk = (abs(step) if step else 1.0 for step in header.values("pixdim")[1:4])
    return di, dj, dk


def _lps(ras: Matrix) -> Matrix:
    return (matrices.scaled(ras[0], -1.0), matrices.scaled(ras[1], -1.0), ras[2])
