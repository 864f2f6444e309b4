"""An array that a script on this machine shares from its memory (client/memory/), by the name of its open file."""

from pathlib import Path

import msgspec
import numpy as np

from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import SCALAR_TYPES, OpenedVolume, VolumeFormat
from volsplat.protocol.description.shared_array import MARK, PAGE_BYTES, SharedArray, header_bytes, shared_array
from volsplat.protocol.text.errors import BadInput

CLOSED = "the script has closed this volume in memory; make it anew, as by Volume(array)"


def open_shared_array(path: Path, part: str) -> OpenedVolume:
    """The reader for the array, whose key is `part`. Raises BadInput if it is damaged, or another one by now."""
    description, offset, key = _told(path)
    if part not in ("", key):
        raise BadInput(CLOSED)
    dims = description.geometry.dims
    piece = Piece(path, dims[2], offset)
    voxels = StoredVoxels(path, dims, np.dtype(description.scalar_type), (piece,))
    voxels.check_files()
    return OpenedVolume(msgspec.structs.replace(description, **voxels.access), voxels.read, voxels.files, parts=())


def _told(path: Path) -> SharedArray:
    try:
        with opened(path) as file:
            head = file.read(PAGE_BYTES)
            told = shared_array(head + file.read(header_bytes(head) - len(head)))
        if told.description.scalar_type not in SCALAR_TYPES or told.description.second_scalar is not None:
            raise ValueError("its voxels are no plain numbers")
    except (ValueError, msgspec.DecodeError) as error:
        raise BadInput(f"{path}: is no array that volsplat shares: {' '.join(str(error).split())}") from None
    return told


FORMATS = (VolumeFormat("array in memory", open_shared_array, lambda head: head.startswith(MARK), parts=False),)
