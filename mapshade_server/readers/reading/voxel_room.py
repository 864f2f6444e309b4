"""Memory for the voxels that a reader fills, and what is said where there is too little."""

import numpy as np
from numpy.typing import DTypeLike

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput


def voxel_room(box: Box, dtype: DTypeLike, source: object) -> Voxels:
    """Room for the voxels of `box`, shaped (k, j, i). Raises BadInput, naming the `source`, if there is too little."""
    try:
        return np.empty(box.size[::-1], dtype)
    except MemoryError:
        gib = box.voxels * np.dtype(dtype).itemsize / 2**30
        raise no_room(source, f"{gib:.1f} GiB of voxels") from None


def no_room(source: object, what: str = "the voxels") -> BadInput:
    return BadInput(
        f"{source}: {what} do not fit into this machine's memory; prepare the volume first (volsplat prepare), "
        "or share it among more machines"
    )
