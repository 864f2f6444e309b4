"""Section 4 of docs/how_it_works/slab_image.md: how much light comes to a place."""

import itertools

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import SlabBook
from by_the_book.placing import Placing
from by_the_book.shading import Shading
from by_the_book.tables import coded
from by_the_book.voxels import packed

Array = NDArray[np.float64]
MOST_OPAQUE = 1 - 1 / 4096


class BlockLight:
    """What is left of the light at the middles of blocks, (i, j, k), and between them."""

    def __init__(self, book: SlabBook, placing: Placing, shading: Shading) -> None:
        self.to_grid = np.linalg.inv(book.to_physical)
        self.spacing = placing.spacing / placing.thickness  # the volume's
        self.side = -(-np.array(placing.dims) // 64)
        self.depths = self._block_depths(book, shading)
        self.from_light = self._from(shading.to_light) if book.shadows else np.ones(self.depths.shape)
        self.from_around = np.ones(self.depths.shape)
        if book.occlusion:
            self.from_around = np.mean([self._from(v) for v in _dodecahedron()], axis=0)

    def _block_depths(self, book: SlabBook, shading: Shading) -> Array:
        packets = packed(book.values, book.to_physical, book.window, book.strength_scale, book.octahedral)
        count = -(-np.array(packets.shape[::-1]) // self.side)
        depth, voxels = np.zeros(count), np.zeros(count)
        low, high = book.bounds
        for k, j, i in np.ndindex(packets.shape):
            block = tuple(np.array((i, j, k)) // self.side)
            voxels[block] += 1
            inside = all(a <= x < b for a, x, b in zip(low, (i, j, k), high, strict=True))
            if inside and not packets[k, j, i] >> 31:
                a, _, _ = shading.of_voxel((i, j, k), (2 * i, 2 * j, 2 * k), int(packets[k, j, i]))
                depth[block] -= np.log(1 - min(coded(a), MOST_OPAQUE))
        mean: Array = depth / voxels
        return mean

    def _from(self, v: Array) -> Array:
        t = self.to_grid @ v / np.linalg.norm(v) / self.side
        axis = int(np.argmax(abs(t)))
        greatest = float(t[axis])
        passes = np.moveaxis(np.exp(-self.depths * abs(1 / greatest) / self.spacing), axis, 0)
        left, right = np.delete(t / abs(greatest), axis)
        light = np.ones(passes.shape)
        order = range(len(light)) if greatest < 0 else range(len(light) - 1, -1, -1)
        for before, here in itertools.pairwise(order):
            light[here] = _moved(light[before] * passes[before], left, right)
        return np.moveaxis(light, 0, axis)

    def at(self, values: Array, grid: Array, outwards: Array) -> Array:
        """Of grid coordinates (n, 3), a block on along physical directions (n, 3), or zeros."""
        step = outwards @ self.to_grid.T / self.side
        length = np.linalg.norm(step, axis=1, keepdims=True)
        place = (grid + 0.5) / self.side - 0.5 + step / np.where(length > 0, length, 1)
        place = np.clip(place, 0, np.array(values.shape) - 1)
        whole = np.minimum(np.floor(place).astype(int), np.maximum(np.array(values.shape) - 2, 0))
        part = place - whole
        found = np.zeros(len(grid))
        for corner in itertools.product((0, 1), repeat=3):
            share = np.prod(np.where(corner, part, 1 - part), axis=1)
            index = np.minimum(whole + corner, np.array(values.shape) - 1)
            found += share * values[tuple(index.T)]
        return found


def _moved(slice_before: Array, left: float, right: float) -> Array:
    """What lies so much further, on straight lines; 1 outside."""
    padded = np.pad(slice_before, 2, constant_values=1.0)
    rows, columns = slice_before.shape
    moved = np.zeros(slice_before.shape)
    (y, fy), (x, fx) = ((int(np.floor(d)), d - np.floor(d)) for d in (left, right))
    for on_row, on_column in itertools.product((0, 1), (0, 1)):
        share = (fy if on_row else 1 - fy) * (fx if on_column else 1 - fx)
        top, first = 2 + y + on_row, 2 + x + on_column
        moved += share * padded[top : top + rows, first : first + columns]
    return moved


def _dodecahedron() -> list[Array]:
    golden = (1 + 5**0.5) / 2
    corners = [np.array(c, np.float64) for c in itertools.product((-1, 1), repeat=3)]
    for one, other in itertools.product((-1, 1), repeat=2):
        corner = np.array([0.0, one / golden, other * golden])
        corners += [corner, corner[[1, 2, 0]], corner[[2, 0, 1]]]
    return corners
