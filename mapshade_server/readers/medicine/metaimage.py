"""MetaImage (.mha, .mhd). SimpleITK gives the place in space, the voxels are read as they are stored.

SimpleITK's streamed extract reads 8 KiB for each row of a box that is narrower than the volume, 32 times too much
for 128 of 256 voxels of 16 bits, and its complaints of truncated files go past its exceptions to the terminal. So
the header is read here too, and only voxels written as text go through SimpleITK.
"""

import re
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.medicine.modality import kind_of_modality
from volsplat.mapshade_server.readers.reading.components import are_colours, chosen_volume
from volsplat.mapshade_server.readers.reading.grids import refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.header_numbers import numbered_names, whole_numbers
from volsplat.mapshade_server.readers.reading.named_files import named_file
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.simple_itk import extracted, geometry_of, header_of
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.unpacked_stream import Packing
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import Geometry, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.length_units import length_unit

LONGEST_HEADER = 1 << 16
SIDES = ("LR", "PA", "SI")  # to which the physical axes lead, and away from which
UNTURNED = "LPS"
CHANNELS = "ElementNumberOfChannels"
NO_SIDES = "its AnatomicalOrientation names no sides, as ITK writes series: left and right cannot be told"
OPPOSITE = str.maketrans("LRPASI", "RLAPIS")
SCALAR_TYPES = {
    "MET_CHAR": "int8",
    "MET_UCHAR": "uint8",
    "MET_SHORT": "int16",
    "MET_USHORT": "uint16",
    "MET_INT": "int32",
    "MET_UINT": "uint32",
    "MET_LONG": "int32",  # as MetaIO has it, whatever a machine's long is
    "MET_ULONG": "uint32",
    "MET_LONG_LONG": "int64",
    "MET_ULONG_LONG": "uint64",
    "MET_FLOAT": "float32",
    "MET_DOUBLE": "float64",
}

MODALITIES = {"MET_MOD_CT": "CT", "MET_MOD_MR": "MR", "MET_MOD_NM": "NM", "MET_MOD_US": "US"}  # by DICOM's words


def recognises(head: bytes) -> bool:
    return re.match(rb"\s*(ObjectType|NDims|ObjectSubType|Comment)\s*=", head) is not None and b"NDims" in head


def open_metaimage(path: Path, part: str = "") -> OpenedVolume:
    """The reader for a MetaImage, and the frame and component of it that are named if there are several.

    Raises BadInput if the header cannot be used or the data is missing.
    """
    fields, end = _fields(path)
    sizes = _integers(path, fields, "DimSize")
    if not sizes or min(sizes) < 1:
        raise _wrong(path, fields, "DimSize")
    refuse_other_dimensions(path, (*sizes[:3], *sizes[4:]))
    frames = sizes[3] if len(sizes) > 3 else 1
    if fields.get("ElementType") not in SCALAR_TYPES:
        raise _wrong(path, fields, "ElementType")
    (channels,) = _integers(path, {CHANNELS: "1", **fields}, CHANNELS)[:1] or (0,)
    if channels < 1:
        raise _wrong(path, fields, CHANNELS)
    if are_colours(channels, SCALAR_TYPES[fields["ElementType"]]):
        refuse_vectors(path, f"{channels} channels a voxel, which are colours")
    frame, name, component, parts = chosen_volume(path, part, frames, channels)
    text = fields.get("BinaryData", "True").lower() == "false"
    compressed = fields.get("CompressedData", "False").lower() == "true"
    if text and frames * channels > 1:
        what = "volumes" if frames > 1 else "components"
        raise BadInput(f"{path}: holds several {what} as text, which volsplat cannot tell apart; save it as binary")
    voxels = _stored(path, fields, end, (sizes[0] * channels, sizes[1], sizes[2] * frames), compressed)
    (voxels.check_there if text else voxels.check_files)()
    reader = header_of(path, "MetaImageIO")
    why_whole = "the voxels are compressed" if compressed else "the voxels are written as text" if text else ""
    geometry = geometry_of(path, reader)
    # SimpleITK's physical axes are LPS; the field says that they are a patient's.
    anatomical = re.fullmatch("[RLAPSI]{3}", fields.get("AnatomicalOrientation", "").upper()) is not None
    kind, kind_from = kind_of_modality(MODALITIES.get(fields.get("Modality", ""), ""))
    description = VolumeDescription(
        name=name,
        format="MetaImage",
        geometry=geometry,
        scalar_type=component.scalar_type(voxels.dtype.name),
        density_name=component.value_name(),
        unit=_unit(fields),
        anatomical=anatomical,
        warnings=(*_told(fields, geometry), *([NO_SIDES] if len(sizes) > 3 and not anatomical else [])),
        kind=kind,
        kind_from=kind_from,
        reads_sub_cubes=not why_whole,
        chunk=(min(voxels.chunk[0], sizes[0]), *voxels.chunk[1:]),
        why_whole=why_whole,
    )
    if text:
        return OpenedVolume(description, lambda box: extracted(path, reader, box), voxels.files, parts=())
    read = component.of_interleaved(path, voxels.dtype.name, lambda box: voxels.read_from(frame * sizes[2], box))
    return OpenedVolume(description, read, voxels.files, parts=parts)


def _unit(fields: dict[str, str]) -> str:
    """Whoever writes a patient's sides means mm, and so does ITK, which writes ???? for those of a series."""
    stated = length_unit(fields.get("DistanceUnits", ""))
    sided = re.fullmatch(r"[RLAPSI]{3}|\?+", fields.get("AnatomicalOrientation", "").upper())
    return stated.symbol if stated is not None else "mm" if sided else ""


def _told(fields: dict[str, str], geometry: Geometry) -> tuple[str, ...]:
    """What the header says beside the matrix and, as in ITK, is not followed."""
    told = []
    letters = fields.get("AnatomicalOrientation", "").upper()
    towards = _axis_letters(geometry)
    # ITK writes from where axes come, others where they lead.
    if re.fullmatch("[RLAPSI]{3}", letters) and letters not in (towards, towards.translate(OPPOSITE)):
        told.append(f"AnatomicalOrientation {letters} contradicts the TransformMatrix, which is followed")
    centre = fields.get("CenterOfRotation", "").split()
    if any(word.strip("-+0.") for word in centre) and towards != UNTURNED:
        told.append("its CenterOfRotation is left out, as by ITK: Offset is the place of the first voxel")
    return tuple(told)


def _axis_letters(geometry: Geometry) -> str:
    """Where i, j and k lead: L or R, P or A, S or I, each by its largest component, in LPS."""
    columns = [matrices.column(geometry.index_to_physical, axis) for axis in range(3)]
    largest = [max(range(3), key=lambda n, one=one: abs(one[n])) for one in columns]  # type: ignore[misc]
    return "".join(SIDES[n][one[n] < 0] for n, one in zip(largest, columns, strict=True))


def _fields(path: Path) -> tuple[dict[str, str], int]:
    """The header's fields, and where it ends: after ElementDataFile, or the list of files that this announces."""
    fields: dict[str, str] = {}
    with opened(path) as file:
        while "ElementDataFile" not in fields:
            line = file.readline(LONGEST_HEADER).decode("utf-8", "replace")
            if not line or file.tell() > LONGEST_HEADER:
                raise BadInput(f"{path}: the header has no ElementDataFile line; it is truncated, fetch it again")
            name, _, value = line.partition("=")
            fields[name.strip()] = value.strip()
        if fields["ElementDataFile"].startswith("LIST"):
            names = file.read(LONGEST_HEADER).decode("utf-8", "replace").split("\n")
            fields["files"] = "\n".join(name.strip() for name in names if name.strip())
        return fields, file.tell()


def _wrong(path: Path, fields: dict[str, str], name: str) -> BadInput:
    return BadInput(f'{path}: the header\'s "{name} = {fields.get(name, "")}" cannot be used; correct the header')


def _integers(path: Path, fields: dict[str, str], name: str) -> tuple[int, ...]:
    try:
        return whole_numbers(fields.get(name, "").split())
    except ValueError:
        raise _wrong(path, fields, name) from None


def _stored(path: Path, fields: dict[str, str], end: int, dims: Index, compressed: bool) -> StoredVoxels:
    names = _data_files(path, fields, dims[2])
    count = len(names) or 1
    if dims[2] % count:
        raise BadInput(f"{path}: the header names {count} files for {dims[2]} slices; correct the header")
    paths = [named_file(path, name) for name in names] or [path]
    sheets = dims[2] // count
    high_first = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", "False")).lower() == "true"
    dtype = np.dtype(SCALAR_TYPES[fields["ElementType"]]).newbyteorder(">" if high_first else "<")
    skip = (_integers(path, fields, "HeaderSize") or (0,))[0]
    if skip < -1:  # by which the voxels are the last of the file
        raise _wrong(path, fields, "HeaderSize")
    promised = sheets * dims[0] * dims[1] * dtype.itemsize
    pieces = []
    for data in paths:
        offset = end if data == path else 0
        if skip == -1 and data.is_file():
            offset = max(data.stat().st_size - promised, 0)
        elif data != path:
            offset += skip
        pieces.append(Piece(data, sheets, offset, Packing.DEFLATE if compressed else Packing.RAW))
    return StoredVoxels(source=path, dims=dims, dtype=dtype, pieces=tuple(pieces))


def _data_files(path: Path, fields: dict[str, str], slices: int) -> list[str]:
    """The names of the data files: one, a list, or a numbered pattern. Empty if the voxels follow the header."""
    value = fields["ElementDataFile"]
    if value.upper() == "LOCAL":
        return []
    if value.startswith("LIST"):
        return fields["files"].split("\n")
    words = value.split()
    if re.search(r"%\d*d", value):
        try:
            return numbered_names(words[0], words[1:4], slices)
        except ValueError:
            raise _wrong(path, fields, "ElementDataFile") from None
    return [value]


FORMATS = (VolumeFormat("MetaImage (.mha, .mhd)", open_metaimage, recognises),)
