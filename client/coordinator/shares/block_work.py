"""How much work each block of a volume is: guessed from what it may show, corrected by what servers measure."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.visible_blocks import block_shares, opacities
from volsplat.protocol.description.block_extremes import block_dims, block_size
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.rules.resolved_view import resolved_bounds

VOXELS_OF_A_PACKET = 100  # that show nothing take as long as one that becomes a packet: their rows are passed by

ALONG = (2, 1, 0)  # arrays are shaped (k, j, i)

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
        k, j, i = (self._blocks(box, other) for other in ALONG)
        layers = np.einsum(f"kji,k,j,i->{'ijk'[axis]}", self._work[k, j, i], *(self._voxels(box, n) for n in ALONG))
        size, first = self._size[axis], box.low[axis] // self._size[axis] + 1
        return [(min((first + n) * size, box.high[axis]), one) for n, one in enumerate(layers.tolist())]

    def of(self, boxes: Sequence[Box]) -> list[float]:
        """All that is in each box."""
        k, j, i = self._inside(boxes)
        rows = self._work @ i.T  # (k, j, box)
        work: list[float] = np.einsum("kn,nk->n", np.einsum("kjn,nj->kn", rows, j), k).tolist()
        return work

    def multiply(self, boxes: Sequence[Box], factors: Sequence[float]) -> None:
        """What is in each of boxes that have nothing in common; a block that is in one by half, by half."""
        whole = self._inside([Box((0, 0, 0), self._dims)])
        k, j, i = (inside / blocks for inside, blocks in zip(self._inside(boxes), whole, strict=True))
        more = (np.array(factors) - 1.0)[:, np.newaxis] * k
        self._work *= 1.0 + np.einsum("nk,nj->kjn", more, j) @ i

    def _inside(self, boxes: Sequence[Box]) -> list[NDArray[np.float64]]:
        """Along k, j and i: how many layers of voxels each box (row) has of each layer of blocks (column)."""
        inside = [np.zeros((len(boxes), layers)) for layers in self._work.shape]
        for axis, layers in zip(ALONG, inside, strict=True):
            for row, box in zip(layers, boxes, strict=True):
                row[self._blocks(box, axis)] = self._voxels(box, axis)
        return inside

    def _blocks(self, box: Box, axis: int) -> slice:
        """The layers of blocks that a box reaches."""
        return slice(box.low[axis] // self._size[axis], -(-box.high[axis] // self._size[axis]))

    def _voxels(self, box: Box, axis: int) -> NDArray[np.float64]:
        """How many layers of voxels of each of them lie in the box."""
        return _shared(box.low[axis], box.high[axis], self._size[axis])


@lru_cache(4096)  # boxes share most of their sides
def _shared(low: int, high: int, size: int) -> NDArray[np.float64]:
    starts = np.arange(low // size * size, high, size)
    return np.minimum(starts + size, high) - np.maximum(starts, low).astype(np.float64)
