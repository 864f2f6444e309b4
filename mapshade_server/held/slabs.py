"""A volume from its first sheet to its last, a few at a time, for whoever looks at all of it and keeps nothing.

Every sheet is read once: the last ones of a slab are the halo of the next, so that compressed files, which only unpack
forwards, and files in chunks are not gone through again and again. Sheets too large for that are cut into tiles.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server.held.sub_cube import Histograms, SubCube
from volsplat.mapshade_server.readers.reading.volume_reader import VolumeReader, Voxels
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.volume import HALO, SCALAR_BYTES, Box, Geometry, Index
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey

SLAB_BYTES = 32 << 20


class Slab(NamedTuple):
    """Some sheets of a box, or a tile of them."""

    box: Box
    values: Voxels  # of the box, (k, j, i)
    sub_cube: SubCube  # which holds them and their halo


@dataclass(frozen=True)
class SlabReader:
    """Reads a volume in slabs of about `slab_bytes`; of a slab as many again are held while the next is read.

    `chunk` is how many voxels along i, j, k only come together; see VolumeDescription.
    """

    geometry: Geometry
    scalar_type: str
    chunk: Index
    read: Callable[[Box], Voxels]
    read_second: Callable[[Box], Voxels] | None = None
    second_range: tuple[float, float] | None = None
    slab_bytes: int = SLAB_BYTES

    def slabs(self, box: Box) -> Iterator[Slab]:
        """Slabs that partition the box. Raises BadInput if the file turns out to be unusable."""
        for tile in self._tiles(box):
            yield from self._of_tile(tile)

    def _tiles(self, box: Box) -> Iterator[Box]:
        """Whole sheets if one chunk's worth of them fits into a slab, else parts of them."""
        (ci, cj, ck), (ni, nj, _) = self.chunk, box.size
        fit = max(1, self.slab_bytes // (SCALAR_BYTES[self.scalar_type] * ck))  # voxels of a sheet
        di = ni if ni * cj <= fit else min(ni, max(ci, fit // cj // ci * ci))
        dj = min(nj, max(cj, fit // di // cj * cj))
        (i0, j0, k0), (i1, j1, k1) = box
        for j in range(j0, j1, dj):
            for i in range(i0, i1, di):
                yield Box((i, j, k0), (min(i + di, i1), min(j + dj, j1), k1))

    def _of_tile(self, tile: Box) -> Iterator[Slab]:
        (i0, j0, k0), (i1, j1, k1) = tile.grown(HALO, self.geometry.dims)
        sheet_bytes = (i1 - i0) * (j1 - j0) * SCALAR_BYTES[self.scalar_type]
        sheets = max(1, self.slab_bytes // sheet_bytes // self.chunk[2]) * self.chunk[2]
        held, first = None, k0  # and the sheet that this begins with
        low, start = tile.low[2], k0
        while low < tile.high[2]:
            end = min((start // sheets + 1) * sheets, k1)
            more = self.read(Box((i0, j0, start), (i1, j1, end)))
            held, start = more if held is None else np.concatenate([held, more]), end
            high = tile.high[2] if end == k1 else end - HALO
            if high > low:
                box = Box((*tile.low[:2], low), (*tile.high[:2], high))
                yield self._slab(box, held, (i0, j0, first))
                held, first, low = held[high - HALO - first :].copy(), high - HALO, high

    def _slab(self, box: Box, held: Voxels, corner: Index) -> Slab:
        around = box.grown(HALO, self.geometry.dims)
        sub_cube = SubCube(self.geometry, box, self.second_range)
        sub_cube.hold(
            held[tuple(slice(low - at, high - at) for low, high, at in zip(*around, corner, strict=True))[::-1]],
            self.read_second(box) if self.read_second is not None else None,
        )
        inside = tuple(slice(low - at, high - at) for low, high, at in zip(*box, corner, strict=True))[::-1]
        return Slab(box, held[inside], sub_cube)


def slab_reader(reader: VolumeReader) -> SlabReader:
    """That of an opened volume."""
    described = reader.describe()
    return SlabReader(
        described.geometry,
        described.scalar_type,
        described.chunk,
        reader.read,
        reader.read_second,
        described.second_scalar,
    )


class PassedBox:
    """A box of a volume that is surveyed as a SubCube is, but not held: its file is read anew for each question."""

    def __init__(self, reader: SlabReader, box: Box) -> None:
        self.box = box
        self.source_bytes = 0  # what was read, with what was read twice
        self.geometry = reader.geometry
        self._reader = reader

    def survey(self) -> Survey:
        """Raises BadInput, as SubCube does."""
        parts = [self._counted(slab).survey() for slab in self._reader.slabs(self.box)]
        survey = parts[0]
        for part in parts[1:]:
            survey = survey.joined(part)
        return survey

    def histograms(self, low: float, high: float, max_gradient: float) -> Histograms:
        density, strength = np.zeros(HISTOGRAM_BINS, np.int64), np.zeros(HISTOGRAM_BINS, np.int64)
        extremes = BlockExtremes.nothing(self._reader.geometry.dims)
        for slab in self._reader.slabs(self.box):
            more = self._counted(slab).histograms(low, high, max_gradient)
            density += np.asarray(more.density)
            strength += np.asarray(more.strength)
            extremes = extremes.joined(more.extremes)
        return Histograms(density.data, strength.data, extremes)

    def _counted(self, slab: Slab) -> SubCube:
        self.source_bytes += slab.sub_cube.source_bytes
        return slab.sub_cube
