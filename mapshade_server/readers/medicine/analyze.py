"""Analyze 7.5, a .hdr of 348 bytes and an .img beside it (eeg.sourceforge.net/ANALYZE75.pdf).

NIfTI grew out of it and says more: what Analyze does not say is where left and right are.
"""

import math
from pathlib import Path
from typing import Literal

import numpy as np

from volsplat.mapshade_server.readers.medicine import nifti
from volsplat.mapshade_server.readers.reading.frames import chosen_frame
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes
from volsplat.mapshade_server.readers.reading.simple_itk import (
    checked_geometry,
    refuse_other_dimensions,
    refuse_vectors,
)
from volsplat.mapshade_server.readers.reading.stored_voxels import Packing, Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.text.errors import BadInput

HEADER_BYTES = 348
BYTE_ORDERS: dict[bytes, Literal["<", ">"]] = {b"\x5c\x01\0\0": "<", b"\0\0\x01\x5c": ">"}
SCALAR_TYPES = {2: "uint8", 4: "int16", 8: "int32", 16: "float32", 64: "float64"}
NO_SIDES = "Analyze 7.5 states no orientation: left and right, front and back cannot be told from this file"


def recognises(head: bytes) -> bool:
    return head[:4] in BYTE_ORDERS and len(head) >= HEADER_BYTES and not nifti.recognises(head)


def open_image(path: Path, part: str) -> OpenedVolume | nifti.NiftiReader:
    """The reader for the .hdr that belongs to an .img, of Analyze or NIfTI. Raises BadInput where there is none."""
    header = path.with_suffix(".HDR" if path.suffix.isupper() else ".hdr")
    if not header.is_file():
        raise BadInput(f"{path}: voxels without their header; put {header.name} beside it")
    head = first_bytes(header, nifti.HEADER_BYTES[2])
    if nifti.recognises(head):
        return nifti.open_nifti(header, part)
    if recognises(head):
        return open_analyze(header, part)
    raise BadInput(f"{path}: {header.name} beside it is no header of Analyze or NIfTI; give the volume another way")


def open_analyze(path: Path, part: str) -> OpenedVolume:
    """The reader for an Analyze header and the frame that is named where there are several.

    Raises BadInput where the header cannot be used or promises more than the .img holds.
    """
    raw = first_bytes(path, HEADER_BYTES)
    order = BYTE_ORDERS[raw[:4]]

    def numbers(offset: int, kind: str, count: int) -> list[float]:
        values: list[float] = np.frombuffer(raw, np.dtype(kind).newbyteorder(order), count, offset).tolist()
        return values

    axes, *sizes = (int(n) for n in numbers(40, "i2", 8))
    if not 1 <= axes <= 7 or min(sizes[:axes]) < 1:
        raise BadInput(f"{path}: the Analyze header's dim {[axes, *sizes]} makes no sense; correct the header")
    refuse_other_dimensions(path, (*sizes[: min(axes, 3)], *sizes[4:axes]))
    dims = (sizes[0], sizes[1], sizes[2])
    frames = sizes[3] if axes >= 4 else 1
    frame = chosen_frame(path, part, frames)
    code = int(numbers(70, "i2", 1)[0])
    if code not in SCALAR_TYPES:
        refuse_vectors(path, f"voxels of Analyze's type {code}, no plain number")
    dtype = np.dtype(SCALAR_TYPES[code]).newbyteorder(order)
    start = numbers(108, "f4", 1)[0]
    if not 0 <= start <= nifti.LARGEST_OFFSET:
        raise BadInput(f"{path}: the Analyze header's vox_offset {start} makes no sense; correct the header")
    data, packing = nifti.image_beside(path)
    offset = int(start) + frame * math.prod(dims) * dtype.itemsize
    why_whole = "" if packing == Packing.RAW else "the file is compressed by gzip"
    piece = Piece(data, dims[2], 0, packing, offset) if why_whole else Piece(data, dims[2], offset)
    voxels = StoredVoxels(path, dims, dtype, (piece,))
    voxels.check_files()
    di, dj, dk = (abs(step) for step in numbers(80, "f4", 3))
    description = VolumeDescription(
        name=f"{path.name}#{frame}" if frames > 1 else path.name,
        format="Analyze 7.5",
        geometry=checked_geometry(path, dims, ((di, 0.0, 0.0), (0.0, dj, 0.0), (0.0, 0.0, dk)), (0.0, 0.0, 0.0)),
        scalar_type=SCALAR_TYPES[code],
        unit="mm" if _text(raw[56:60]).lower() == "mm" else "",
        value_unit=_text(raw[60:68]),
        reads_sub_cubes=not why_whole,
        chunk=voxels.chunk,
        why_whole=why_whole,
        warnings=(NO_SIDES,),
    )
    return OpenedVolume(description, voxels.read, lambda: voxels.files)


def _text(raw: bytes) -> str:
    """The text before the first NUL, "" where it is no plain text."""
    text = raw.partition(b"\0")[0].decode("latin-1").strip()
    return text if text.isascii() and text.isprintable() else ""
