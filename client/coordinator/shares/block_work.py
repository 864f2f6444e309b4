"""How much work each block of a volume is: guessed from what it may show, corrected by what servers measure."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.visible_blocks import block_shares, opacities
from volsplat.protocol.description.block_extremes import block_dims, block_size
from volsplat.protocol.description.scene import TABLE_ENTRIES, Scene
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.rules.resolved_view import resolved_bounds

VOXELS_OF_A_PACKET = 100  # that show nothing take as long as one that becomes a packet: their rows are passed by

Layer = tuple[int, float]  # where it ends on an axis, and its work


class BlockWork:
    """Work of a voxel by block, in any unit."""

    def __init__(self, dims: Index, work: ArrayLike) -> None:
        """`work` counts blocks shaped (k, j, i)."""
        self._size, self._dims = block_size(dims), dims
        self._work = np.array(work, np.float64).reshape(block_dims(dims)[::-1])

    @classmethod
    def expected(cls, volume: SurveyedVolume, scene: Scene) -> "BlockWork":
        """Of frames of which nothing has been measured. Raises ValueError for bounds that the volume does not have."""
        geometry = volume.description.geometry
        known = opacities(scene)
        seen = [True] * TABLE_ENTRIES if known is None else [opacity > 0.0 for opacity in known]
        bounds, quantisation = resolved_bounds(scene, geometry), volume.quantisation(scene.quantise)
        work = np.full(block_dims(geometry.dims)[::-1], 1.0 / VOXELS_OF_A_PACKET)
        (i, j, k), shares = block_shares(seen, geometry.dims, bounds, quantisation, volume.extremes)
        nk, nj, ni = shares.shape
        work[k : k + nk, j : j + nj, i : i + ni] += shares
        return cls(geometry.dims, work)

    def along(self, box: Box, axis: int) -> list[Layer]:
        """Of the box's layers of blocks along an axis: where each ends, and its work."""
        work = self._of_blocks(box)
        for other in range(3):
            voxels = self._voxels(box, other)
            work = work * _along(other, voxels) if other == axis else _summed(work, other, voxels)
        size, first = self._size[axis], box.low[axis] // self._size[axis] + 1
        return [(min((first + n) * size, box.high[axis]), one) for n, one in enumerate(work.ravel().tolist())]

    def of(self, box: Box) -> float:
        """All that is in a box."""
        return sum(work for _, work in self.along(box, 2))

    def multiply(self, box: Box, factor: float) -> None:
        """What is in a box; a block that is in it by half, by half."""
        whole, part = Box((0, 0, 0), self._dims), np.ones((1, 1, 1))
        for axis, first in enumerate(low // size for low, size in zip(box.low, self._size, strict=True)):
            voxels = self._voxels(box, axis)
            part = part * _along(axis, voxels / self._voxels(whole, axis)[first : first + len(voxels)])
        self._of_blocks(box)[...] *= 1.0 + (factor - 1.0) * part

    def _of_blocks(self, box: Box) -> NDArray[np.float64]:
        """Of the blocks that a box reaches."""
        k, j, i = (
            slice(low // size, -(-high // size)) for low, high, size in reversed([*zip(*box, self._size, strict=True)])
        )
        return self._work[k, j, i]

    def _voxels(self, box: Box, axis: int) -> NDArray[np.float64]:
        """How many layers of voxels of each layer of blocks lie in a box."""
        low, high, size = box.low[axis], box.high[axis], self._size[axis]
        starts = np.arange(low // size * size, high, size)
        return np.minimum(starts + size, high) - np.maximum(starts, low).astype(np.float64)


def _along(axis: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """For blocks shaped (k, j, i)."""
    return values.reshape([-1 if axis == other else 1 for other in (2, 1, 0)])


def _summed(work: NDArray[np.float64], axis: int, voxels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Over the layers of an axis, each of so many voxels."""
    summed: NDArray[np.float64] = (work * _along(axis, voxels)).sum(axis=2 - axis, keepdims=True)
    return summed
