"""Section 3 of docs/how_it_works/image.md: where the grid lies on the screen."""

import itertools
from collections.abc import Sequence
from math import floor

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import Book

Array = NDArray[np.float64]


class Placing:
    """The matrices of a picture, and the fixed point of its positions; y of the screen counts up, of `down` down."""

    def __init__(self, book: Book) -> None:
        m, (width, height) = book.to_physical, book.size
        self.spacing = abs(np.linalg.det(m)) ** (1 / 3)  # h
        self.turn = _rotation(book.rotation)
        self.screen = book.zoom / self.spacing * self.turn @ m  # S
        self.down = np.diag([1.0, -1.0, 1.0]) @ self.screen
        at_zero = np.array([(width - 1) / 2, (height - 1) / 2]) - self.down[:2] @ np.array(book.center)
        self.origin = [rounded(2.0**32 * c) for c in at_zero]
        self.half = [[rounded(2.0**31 * self.down[xy, a]) for a in range(3)] for xy in range(2)]
        self.dims = tuple(reversed(book.values.shape))
        self.whole = np.array(book.whole or self.dims)
        self.factors = np.array(book.factors)
        self.thickness = float(np.prod(self.factors)) ** (1 / 3)  # f of section 11
        extent = self.whole / self.factors
        self.middle = extent / 2 - 0.5
        corners = [m @ (np.array(c) * extent / 2) for c in itertools.product((-1, 1), repeat=3)]
        self.ball = max(float(np.linalg.norm(c)) for c in corners) * book.zoom / self.spacing  # in pixels

    def in_volume(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """The voxels of the volume that have the grid fields of a level's (…, 3)."""
        voxel: NDArray[np.int64] = np.minimum(index * self.factors + self.factors // 2, self.whole - 1)
        return voxel

    def fixed(self, doubled: Sequence[int]) -> list[int]:
        """Of a place at a doubled index, in 2^-32 pixel."""
        return [self.origin[xy] + sum(d * h for d, h in zip(doubled, self.half[xy], strict=True)) for xy in range(2)]


def rounded(x: float) -> int:
    return floor(x + 0.5)


def _rotation(quaternion: tuple[float, float, float, float]) -> Array:
    x, y, z, w = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
