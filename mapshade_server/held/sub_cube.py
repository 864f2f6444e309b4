"""A sub-cube: the box of the grid that a map/shade server holds, first as source values, then as voxel packets."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.held.block_densities import BlockDensities, block_densities
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.mapshade_server.readers.reading.volume_reader import VolumeReader
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims, block_size
from volsplat.protocol.description.volume import HALO, Box, Geometry, Index
from volsplat.protocol.rules.index_rules import Quantisation, Survey, physical_gradient
from volsplat.protocol.rules.levels import LISTS_PER_PACKET
from volsplat.protocol.text.errors import BadInput, LocalProtocolError

FILL_OF_FLOAT64 = 1e300  # beyond: +-1.797e308 is in use


class Histograms(NamedTuple):
    """Counts of index_rules.HISTOGRAM_BINS bins each, int64, and what lies where."""

    density: memoryview  # over the survey's low..high
    strength: memoryview  # over 0..max_gradient, or over the second scalar's range
    extremes: BlockExtremes  # of the whole volume's blocks, as far as this box knows

    def joined(self, other: "Histograms") -> "Histograms":
        """Of both boxes together."""
        density, strength = (np.asarray(own) + np.asarray(more) for own, more in zip(self[:2], other[:2], strict=True))
        return Histograms(density.data, strength.data, self.extremes.joined(other.extremes))


class SubCube:
    """One box of a volume. Order of use: `read` (or `hold`), `survey`, `histograms`, `pack`; then it has `packets`.

    `second_scalar` is the range of what its packets hold in place of gradient strength, None if they hold that.
    """

    def __init__(self, geometry: Geometry, box: Box, second_scalar: tuple[float, float] | None = None) -> None:
        self.geometry = geometry
        self.box = box
        self.mixture: LevelMixture | None = None  # what its voxels stand for, if they are not the volume's own
        self._second_scalar = second_scalar
        self._matrix = [entry for row in physical_gradient(geometry) for entry in row]
        self._source: Any = None
        self._second: Any = None
        self._low: Index = (0, 0, 0)
        self._packets: _kernels.Array | None = None
        self._classified_rows = _kernels.ClassifiedRows(box.size, LISTS_PER_PACKET)
        self._needed_voxels: _kernels.NeededVoxels | None = None
        # Bytes that its needed voxels may take: there was room for them when they were looked for last. They go as soon
        # as others are.
        self.slab_room = 0

    @classmethod
    def of_volume(cls, geometry: Geometry, values: Any, box: Box | None = None) -> "SubCube":
        """A sub-cube of a whole volume in memory: `values` is a tensor or array shaped (k, j, i), not copied."""
        sub_cube = cls(geometry, box or geometry.box)
        sub_cube.hold(values[sub_cube.box.grown(HALO, geometry.dims).slices()])
        return sub_cube

    @classmethod
    def of_packets(
        cls, geometry: Geometry, box: Box, packets: Any, lists: float, mixture: LevelMixture | None = None
    ) -> "SubCube":
        """A sub-cube whose packets were made before: uint32 (k, j, i), with some room behind them.

        `lists` of what can be seen may take this share of their bytes. `mixture` is that of the level that it is of.
        """
        sub_cube = cls(geometry, box)
        sub_cube.mixture = mixture
        sub_cube._packets = packets
        sub_cube._classified_rows = _kernels.ClassifiedRows(box.size, lists)
        return sub_cube

    def read(self, reader: VolumeReader) -> None:
        """Read the box and its halo. Raises BadInput if the file turns out to be unusable."""
        source = reader.read(self.box.grown(HALO, self.geometry.dims))
        self.hold(source, None if reader.read_second is None else reader.read_second(self.box))

    def hold(self, source: Any, second: Any = None) -> None:
        """Take the values of the box and its halo, shaped (k, j, i), of any integer or float type.

        `second` has the second scalar of the box alone, if there is one.
        """
        whole = self.box.grown(HALO, self.geometry.dims)
        ni, nj, nk = whole.size
        if tuple(source.shape) != (nk, nj, ni):
            raise LocalProtocolError(f"a sub-cube of {(nk, nj, ni)} voxels with halo was given {tuple(source.shape)}")
        if (second is None) != (self._second_scalar is None):
            raise LocalProtocolError("a sub-cube needs a second scalar where the volume's description states its range")
        low = self.box.low
        self._low = (low[0] - whole.low[0], low[1] - whole.low[1], low[2] - whole.low[2])
        self._source, self._second = source, second
        self._packets = None

    def survey(self) -> Survey:
        """Extremes and counts of the box's own voxels.

        Raises BadInput for values so great that differences of two of them, in whichever boxes, overflow float64.
        """
        low, high, max_gradient, no_data = _kernels.survey(*self._source_box())
        greatest = max(abs(low), abs(high)) if low <= high else 0.0
        steepest = 2 * greatest * max(1.0, sum(abs(entry) for entry in self._matrix))
        if not math.isfinite(steepest * steepest):
            fill = ", or mark as NaN those that stand for no data" if greatest > FILL_OF_FLOAT64 else ""
            raise BadInput(
                f"the volume's values reach {greatest:.3g} in size, too far for gradients; divide them by a constant"
                f"{fill}"
            )
        return Survey(low=low, high=high, max_gradient=max_gradient, voxels=self.box.voxels, no_data=no_data)

    def histograms(self, low: float, high: float, max_gradient: float) -> Histograms:
        """Counts of the box's voxels over the whole volume's ranges."""
        strengths = self._second_scalar or (0.0, max_gradient)
        dims = self.geometry.dims
        density, strength, extremes = _kernels.histograms(
            *self._source_box(),
            self._second,
            (low, high),
            strengths,
            begin=self.box.low,
            block_size=block_size(dims),
            block_count=block_dims(dims),
        )
        told = BlockExtremes.of_bytes(memoryview(extremes).cast("B"))
        return Histograms(memoryview(density), memoryview(strength), told)

    def pack(self, quantisation: Quantisation) -> None:
        """Make the voxel packets and let the source go."""
        self._packets = _kernels.pack(
            *self._source_box(),
            self._second,
            window_low=quantisation.window[0],
            density_scale=quantisation.density_scale,
            strength_low=quantisation.strength_low,
            strength_scale=quantisation.strength_scale,
            octahedral=quantisation.directions == "octahedral",
        )
        self._source = self._second = None
        self._classified_rows = _kernels.ClassifiedRows(self.box.size, LISTS_PER_PACKET)
        self._needed_voxels, self.slab_room = None, 0
        self.__dict__.pop("block_densities", None)

    @property
    def classified_rows(self) -> _kernels.ClassifiedRows:
        """What a walk keeps for the next one: which voxels of each row can be seen."""
        return self._classified_rows

    @cached_property
    def block_densities(self) -> BlockDensities:
        """Between which densities its blocks' voxels lie."""
        return block_densities(np.asarray(memoryview(self.packets)))

    @property
    def needed_voxels(self) -> _kernels.NeededVoxels:
        """What a walk of slabs keeps for the next one: which voxels it takes. Raises ValueError for long sub-cubes."""
        if self._needed_voxels is None:
            self._needed_voxels = _kernels.NeededVoxels(self.box.size)
        return self._needed_voxels

    @property
    def packets(self) -> "_kernels.Array":
        """uint32 (k, j, i); see packet_layout. Take it with torch.from_dlpack or memoryview."""
        if self._packets is None:
            raise LocalProtocolError("a sub-cube was asked for voxel packets before it was packed")
        return self._packets

    def _source_box(self) -> tuple[Any, Index, Index, list[float]]:
        if self._source is None:
            raise LocalProtocolError("a sub-cube was asked for its source after packing; read it again first")
        return self._source, self._low, self.box.size, self._matrix


def mixture_of(sub_cubes: Sequence[SubCube]) -> LevelMixture | None:
    """What the voxels of sub-cubes of one level stand for."""
    return sub_cubes[0].mixture if sub_cubes else None
