"""Source values in a raw file beside the store: of coarser levels, and of volumes that are compressed as a whole."""

import os
from pathlib import Path

import numpy as np

from volsplat.mapshade_server.readers.reading.stored_voxels import Piece, StoredVoxels
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box, Index


class LevelSource:
    """A grid of values in a raw file, written by boxes and called to read one."""

    def __init__(self, path: Path, dims: Index, scalar_type: str) -> None:
        self._dtype = np.dtype(scalar_type)
        self._dims = dims
        self._path = path
        self._voxels = StoredVoxels(path, dims, self._dtype, (Piece(path, dims[2]),))

    def __call__(self, box: Box) -> Voxels:
        return self._voxels.read(box)

    def write(self, box: Box, values: Voxels) -> None:
        """Lays down the values of a box for good; the file grows as needed."""
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o666)
        try:
            if box.size[:2] == self._dims[:2]:
                self._put(descriptor, values, (0, 0, box.low[2]))
            else:
                for k, sheet in enumerate(values, box.low[2]):
                    self._put_sheet(descriptor, sheet, box, k)
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

    def _put_sheet(self, descriptor: int, sheet: Voxels, box: Box, k: int) -> None:
        if box.size[0] == self._dims[0]:
            self._put(descriptor, sheet, (0, box.low[1], k))
            return
        for j, row in enumerate(sheet, box.low[1]):
            self._put(descriptor, row, (box.low[0], j, k))

    def _put(self, descriptor: int, values: Voxels, first: Index) -> None:
        ni, nj, _ = self._dims
        offset = ((first[2] * nj + first[1]) * ni + first[0]) * self._dtype.itemsize
        view = np.ascontiguousarray(values, self._dtype).data.cast("B")
        while view:
            written = os.pwrite(descriptor, view, offset)
            view, offset = view[written:], offset + written
