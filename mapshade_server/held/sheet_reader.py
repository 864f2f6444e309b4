"""A volume from its first sheet to its last, a few at a time, for whoever looks at all of it and keeps nothing.

Every sheet is read once: the last ones of a reading are the halo of the next, so that compressed files, which only
unpack forwards, and files in chunks are not gone through again and again. Sheets too large for that are cut into tiles.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, VolumeReader, Voxels
from volsplat.protocol.description.volume import HALO, SCALAR_BYTES, Box, Geometry, Index

BYTES_AT_ONCE = 32 << 20


class Sheets(NamedTuple):
    """Some sheets of a box, or a tile of them."""

    box: Box
    values: Voxels  # of the box, (k, j, i)
    sub_cube: SubCube  # which holds them and their halo


@dataclass(frozen=True)
class SheetReader:
    """Reads about `bytes_at_once` of a volume; as many again are held of what was read before.

    `chunk` is how many voxels along i, j, k only come together; see VolumeDescription.
    """

    geometry: Geometry
    scalar_type: str
    chunk: Index
    read: ReadBox
    read_second: ReadBox | None = None
    second_range: tuple[float, float] | None = None
    bytes_at_once: int = BYTES_AT_ONCE

    def sheets(self, box: Box) -> Iterator[Sheets]:
        """Those of the box, each voxel once. Raises BadInput if the file turns out to be unusable."""
        for tile in self._tiles(box):
            yield from self._of_tile(tile)

    def _tiles(self, box: Box) -> Iterator[Box]:
        """Whole sheets if one chunk's worth of them may be read at once, else parts of them."""
        (ci, cj, ck), (ni, nj, _) = self.chunk, box.size
        fit = max(1, self.bytes_at_once // (SCALAR_BYTES[self.scalar_type] * ck))  # voxels of a sheet
        di = ni if ni * cj <= fit else min(ni, max(ci, fit // cj // ci * ci))
        dj = min(nj, max(cj, fit // di // cj * cj))
        for rows in box.layers(1, dj, box.low[1]):
            yield from rows.layers(0, di, box.low[0])

    def _of_tile(self, tile: Box) -> Iterator[Sheets]:
        (i0, j0, k0), (i1, j1, k1) = tile.grown(HALO, self.geometry.dims)
        sheet_bytes = (i1 - i0) * (j1 - j0) * SCALAR_BYTES[self.scalar_type]
        sheets = max(1, self.bytes_at_once // sheet_bytes // self.chunk[2]) * self.chunk[2]
        held, first = None, k0  # and the sheet that this begins with
        low, start = tile.low[2], k0
        while low < tile.high[2]:
            end = min((start // sheets + 1) * sheets, k1)
            more = self.read(Box((i0, j0, start), (i1, j1, end)))
            held, start = more if held is None else np.concatenate([held, more]), end
            high = tile.high[2] if end == k1 else end - HALO
            if high > low:
                box = Box((*tile.low[:2], low), (*tile.high[:2], high))
                yield self._held(box, held, (i0, j0, first))
                held, first, low = held[high - HALO - first :].copy(), high - HALO, high

    def _held(self, box: Box, held: Voxels, corner: Index) -> Sheets:
        around = box.grown(HALO, self.geometry.dims)
        sub_cube = SubCube(self.geometry, box, self.second_range)
        sub_cube.hold(held[around.slices(corner)], None if self.read_second is None else self.read_second(box))
        return Sheets(box, held[box.slices(corner)], sub_cube)


def sheet_reader(reader: VolumeReader) -> SheetReader:
    """That of an opened volume."""
    described = reader.description
    return SheetReader(
        described.geometry,
        described.scalar_type,
        described.chunk,
        reader.read,
        reader.read_second,
        described.second_scalar,
    )
