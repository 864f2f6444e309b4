"""NIfTI-1 and NIfTI-2, plain or gzip, also as .hdr and .img (nifti.nimh.nih.gov).

The header is read here because SimpleITK refuses or straightens a sheared sform, and reads truncated files
without a word. The sform counts if its code is set and it spans space, else the qform, else the spacing alone.
"""

import math
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.medicine.modality import kind_beside
from volsplat.mapshade_server.readers.medicine.nifti_header import INTENT_STATISTICS, NiftiHeader, nifti_header
from volsplat.mapshade_server.readers.reading.grids import checked_geometry, geometry
from volsplat.mapshade_server.readers.reading.stored_voxels import StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, ReadBox, VolumeFormat, by_sheets
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector

MAGICS = {1: (b"n+1\0", b"ni1\0"), 2: (b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n")}
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
STATISTICS = {2: "correlation", 3: "t statistic", 4: "F statistic", 5: "z statistic", 6: "chi-squared statistic"}
NO_SIDES = "the file states neither sform nor qform: left and right cannot be told"
OTHER_HAND = "its sform and qform disagree on what is left and what is right; the sform is followed"
FLAT_SFORM = "its sform spans no space; the qform is followed"
NO_UNIT = "the file states no unit of length: mm is taken, which writers mean by the scanner's space"
MILLIMETRES_PER_UNIT = {1: 1000.0, 2: 1.0, 3: 0.001}


def recognises(head: bytes) -> bool:
    return head[344:348] in MAGICS[1] or head[4:12] in MAGICS[2]


def open_nifti(path: Path, part: str) -> OpenedVolume:
    """The reader for a NIfTI file, and the frame and component of it that are named if there are several.

    Values are scaled by the header's slope and intercept, as float32 or float64. Raises BadInput if the header cannot
    be used or promises too much.
    """
    header = nifti_header(path)
    name, stored, component, parts = header.voxels(part, SCALAR_TYPES)
    voxels = stored[0]
    slope, intercept = header.values("scl")
    scaled = slope != 0.0 and math.isfinite(slope) and math.isfinite(intercept) and (slope, intercept) != (1.0, 0.0)
    scaled_type = "float32" if voxels.dtype.itemsize <= 2 or voxels.dtype.name == "float32" else "float64"
    number_type = scaled_type if scaled else voxels.dtype.name
    matrix, origin, anatomical, warnings = _place(header)
    unit_code = int(header.values("units")[0]) & 7
    kind, kind_from = _kind(path, header)
    to_millimetres = MILLIMETRES_PER_UNIT.get(unit_code, 1.0)
    description = VolumeDescription(
        name=name,
        format=f"NIfTI-{header.version}",
        geometry=checked_geometry(
            path, voxels.dims, matrices.times(matrix, to_millimetres), matrices.scaled(origin, to_millimetres)
        ),
        scalar_type=component.scalar_type(number_type),
        unit="mm" if anatomical or unit_code in MILLIMETRES_PER_UNIT else "",
        anatomical=anatomical,
        warnings=(*header.start_told, *warnings, *([NO_UNIT] if anatomical and unit_code == 0 else [])),
        kind=kind,
        kind_from=kind_from,
        density_name=component.value_name(STATISTICS.get(header.intent, "")),
        **voxels.access,
    )

    def numbers(one: StoredVoxels) -> ReadBox:
        if not scaled:
            return one.read
        return by_sheets(path, scaled_type, lambda box: one.read(box).astype(np.float64) * slope + intercept)

    read = component.of_separate(path, number_type, [numbers(one) for one in stored])
    return OpenedVolume(description, read, voxels.files, parts=parts)


def _kind(path: Path, header: NiftiHeader) -> tuple[Kind, str]:
    intent = header.intent
    if intent == INTENT_LABEL:
        return Kind.LABELS, f"its intent {intent}, labels"
    if intent in INTENT_STATISTICS:
        return Kind.STATISTIC_MAP, f"its intent {intent}, a test's statistic"
    return kind_beside(path)


def _place(header: NiftiHeader) -> tuple[Matrix, Vector, bool, tuple[str, ...]]:
    """Index-to-physical matrix and origin in LPS, whether the file states them in patient space, and warnings."""
    qform, sform = (int(code) for code in header.values("codes"))
    if qform <= 0 and sform <= 0:
        di, dj, dk = _spacing(header)
        return ((di, 0.0, 0.0), (0.0, dj, 0.0), (0.0, 0.0, dk)), (0.0, 0.0, 0.0), False, (NO_SIDES,)
    flat = qform > 0 and sform > 0 and not _spans_space(*_sform(header))
    matrix, origin = _qform(header) if sform <= 0 or flat else _sform(header)
    told: tuple[str, ...] = (FLAT_SFORM,) if flat else ()
    if (
        not flat
        and qform > 0
        and sform > 0
        and matrices.determinant(matrix) * matrices.determinant(_qform(header)[0]) < 0
    ):
        told = (OTHER_HAND,)
    return matrix, origin, True, told


def _spans_space(matrix: Matrix, origin: Vector) -> bool:
    try:
        geometry((1, 1, 1), matrix, origin)
    except ValueError:
        return False
    return True


def _sform(header: NiftiHeader) -> tuple[Matrix, Vector]:
    s = header.values("srow")
    return _lps(((s[0], s[1], s[2]), (s[4], s[5], s[6]), (s[8], s[9], s[10]))), (-s[3], -s[7], s[11])


def _qform(header: NiftiHeader) -> tuple[Matrix, Vector]:
    di, dj, dk = _spacing(header)
    b, c, d, x, y, z = header.values("quatern")
    a = math.sqrt(max(0.0, 1.0 - (b * b + c * c + d * d)))
    turned = matrices.rotation_from_quaternion((b, c, d, a))
    dk = -dk if header.values("pixdim")[0] < 0 else dk
    rows: Matrix = tuple((row[0] * di, row[1] * dj, row[2] * dk) for row in turned)  # type: ignore[assignment]
    return _lps(rows), (-x, -y, z)


def _spacing(header: NiftiHeader) -> Vector:
    di, dj, dk = (abs(step) if step else 1.0 for step in header.values("pixdim")[1:4])
    return di, dj, dk


def _lps(ras: Matrix) -> Matrix:
    return (matrices.scaled(ras[0], -1.0), matrices.scaled(ras[1], -1.0), ras[2])


FORMATS = (VolumeFormat("NIfTI (.nii, .nii.gz)", open_nifti, recognises, gzip=True),)
