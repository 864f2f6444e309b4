"""FreeSurfer's volumes (.mgh, and .mgz or .mgh.gz packed by gzip).

https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat. The header states the directions of i, j, k and the
place of the middle, in right, anterior, superior. It is read here since SimpleITK does not know the format.
"""

import math
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.reading.grids import checked_geometry, refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes
from volsplat.mapshade_server.readers.reading.part_options import chosen_frame
from volsplat.mapshade_server.readers.reading.stored_voxels import one_piece
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat
from volsplat.protocol.description.volume import Geometry, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

VERSION = 1
HEADER_BYTES = 284
SCALAR_TYPES = {0: "uint8", 1: "int32", 3: "float32", 4: "int16", 10: "uint16"}
CORONAL = (-1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0)  # of i, j, k, if none are stated, as FreeSurfer has it
NO_PLACE = "the file states no place: FreeSurfer's coronal directions and steps of 1 mm are taken"


def open_mgh(path: Path, part: str) -> OpenedVolume:
    """The reader for a volume, and the frame of it that is named if there are several. Raises BadInput."""
    raw = first_bytes(path, HEADER_BYTES)
    if len(raw) < HEADER_BYTES:
        raise BadInput(f"{path}: its header is truncated; fetch the file again")
    version, ni, nj, nk, frames, code, _ = np.frombuffer(raw, ">i4", 7).tolist()
    if version != VERSION or min(ni, nj, nk, frames) < 1:
        raise BadInput(f"{path}: is no volume of FreeSurfer's, or its header is damaged; fetch the file again")
    if code not in SCALAR_TYPES:
        refuse_vectors(path, f"voxels of FreeSurfer's type {code}, no plain number")
    dims, dtype = (ni, nj, nk), np.dtype(SCALAR_TYPES[code]).newbyteorder(">")
    refuse_other_dimensions(path, dims)
    frame, name = chosen_frame(path, part, frames)
    voxels = one_piece(path, dims, dtype, HEADER_BYTES + frame * math.prod(dims) * dtype.itemsize)
    (placed,) = np.frombuffer(raw, ">i2", 1, 28).tolist()
    description = VolumeDescription(
        name=name,
        format="FreeSurfer MGH",
        geometry=_geometry(path, dims, raw if placed else b""),
        scalar_type=dtype.name,
        unit="mm",
        anatomical=True,
        warnings=() if placed else (NO_PLACE,),
        **voxels.access,
    )
    return OpenedVolume(description, voxels.read, parts=())


def _geometry(path: Path, dims: Index, raw: bytes) -> Geometry:
    """In LPS; `raw` is the header, b"" if it states no place."""
    steps, directions, middle = np.ones(3), np.array(CORONAL), np.zeros(3)
    if raw:
        stated = np.frombuffer(raw, ">f4", 15, 30).astype(np.float64)
        steps, directions, middle = stated[:3], stated[3:12], stated[12:]
    to_lps = np.diag([-1.0, -1.0, 1.0])
    matrix = to_lps @ (directions.reshape(3, 3).T * steps)
    return checked_geometry(path, dims, matrix, to_lps @ middle - matrix @ (np.array(dims) / 2))


FORMATS = (VolumeFormat("FreeSurfer (.mgh, .mgz)", open_mgh, extensions=(".mgh", ".mgz", ".mgh.gz"), gzip=True),)
