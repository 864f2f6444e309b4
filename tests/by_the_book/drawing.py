"""A renderer written from docs/how_it_works/image.md alone: if that does not suffice, its pictures are not ours.

It imports nothing of ours, and knows no trick: float64, one sample after the other. Section numbers are the page's.
"""

import itertools
from math import ceil, floor, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import Book
from by_the_book.edges import between_edges
from by_the_book.kernels import PROFILE, projection
from by_the_book.placing import Placing, rounded
from by_the_book.shading import Shading
from by_the_book.tables import coded
from by_the_book.voxels import packed

Array = NDArray[np.float64]
STRIDES = {"A": 4, "B": 2, "C": 1, "D": 1, "E": 1, "F": 1}


def draw(book: Book) -> Array:
    """The image (H, W, 4)."""
    return _Drawing(book).drawn()


class _Drawing:
    def __init__(self, book: Book) -> None:
        self.book = book
        self.stride = STRIDES[book.step]
        self.footprints = book.step in "DEF"
        self.placing = Placing(book)
        self.screen = self.placing.screen
        self.shading = Shading(book, self.placing)
        self._find_order()
        self.visits = [_visits(*on_axis, self.stride) for on_axis in zip(*book.bounds, strict=True)]
        self.packets = packed(book.values, book.to_physical, book.window, book.strength_scale, book.octahedral)
        self.buffer = np.zeros((book.size[1], book.size[0], 4))

    def _find_order(self) -> None:
        ray = self.book.zoom * np.linalg.inv(self.screen)[:, 2]
        fixed = [rounded(2.0**32 * r) for r in ray]
        apart = [1, 1, 1]
        if self.footprints:
            rows = np.linalg.norm(np.linalg.inv(self.book.to_physical), axis=1)
            apart = [rounded(2.0**20 / (self.placing.spacing * row)) for row in rows]
        self.axes = sorted((2, 1, 0), key=lambda a: -abs(fixed[a]) * apart[a])
        self.upwards = [(fixed[a] >= 0) != self.book.front_to_back for a in self.axes]

    # 5. colour and opacity

    def _shaded(self, ordinals: tuple[int, ...]) -> tuple[Array, float] | None:
        """Colour and opacity of a sample, in the steps that the wire has; None if it is transparent."""
        index = self._index(ordinals)
        packet = int(self.packets[index[2], index[1], index[0]])
        if packet >> 31:
            return None
        a, emit, refl = self.shading.of_voxel(index, self._doubled(ordinals), packet)
        colour = emit + refl * self.shading.light[packet >> 16 & 0x7FFF]
        t = self._thickness([high - low for low, high in self._blocks(ordinals)])
        opacity = coded(a if t == 1 else -np.expm1(t * np.log1p(-a)) if a < 1 else float(t > 0))
        return (np.floor(255 * np.clip(colour, 0, 1) + 0.5) / 255, opacity) if opacity else None

    def _thickness(self, block: list[int]) -> float:
        if self.footprints:
            return 1.0
        if self._fits_a_pixel:
            return float(self.book.zoom**2 * np.prod(block))
        sheet, row, sample = self.axes
        area = abs(np.linalg.det(self.screen[:2][:, [row, sample]]))
        return float(block[sheet] * abs(np.linalg.det(self.screen)) / (area * self.book.zoom) / 3)

    @property
    def _fits_a_pixel(self) -> bool:
        fits = max(self.stride * abs(self.screen[xy]).sum() for xy in range(2)) <= 1
        return bool(fits) and not self.book.precise

    # 4. order

    def _visit(self, loop: int, ordinal: int) -> tuple[int, tuple[int, int]]:
        """The index at an ordinal of a loop, and its block."""
        visits = self.visits[self.axes[loop]]
        return visits[ordinal if self.upwards[loop] else len(visits) - 1 - ordinal]

    def _index(self, ordinals: tuple[int, ...]) -> tuple[int, int, int]:
        by_axis = {self.axes[loop]: self._visit(loop, n)[0] for loop, n in enumerate(ordinals)}
        return by_axis[0], by_axis[1], by_axis[2]

    def _blocks(self, ordinals: tuple[int, ...]) -> list[tuple[int, int]]:
        by_axis = {self.axes[loop]: self._visit(loop, n)[1] for loop, n in enumerate(ordinals)}
        return [by_axis[a] for a in range(3)]

    @property
    def _counts(self) -> list[int]:
        return [len(self.visits[a]) for a in self.axes]

    # 9. combining

    def drawn(self) -> Array:
        if self.footprints:
            self._splat_footprints()
        elif self._fits_a_pixel:
            self._splat_pixels()
        else:
            self._splat_cells()
        return between_edges(self.buffer, self.book, self.placing) if self.book.edges else self.buffer

    def _combine(self, where: tuple[slice, slice], weight: Array, colour: Array, opacity: float) -> None:
        pixels = self.buffer[where]
        a = np.minimum(1, weight * opacity)[..., None]
        source = np.append(colour, 1.0)
        if self.book.front_to_back:
            added = pixels + (1 - pixels[..., 3:]) * a * source
            pixels[:] = np.where(pixels[..., 3:] >= 1 - 1 / 1024, pixels, added)
        else:
            pixels += a * (source - pixels)

    # 6. positions

    def _place(self, ordinals: tuple[int, ...]) -> tuple[list[int], int]:
        """In 1/64 pixel, and the sheet's threshold."""
        threshold = (2**31 + 2**25 + 2654435769 * self._index(ordinals)[self.axes[0]]) % 2**32
        fixed = self.placing.fixed(self._doubled(ordinals))
        return [(value + threshold % 2**26) // 2**26 for value in fixed], threshold

    def _doubled(self, ordinals: tuple[int, ...]) -> list[int]:
        return [low + high - 1 for low, high in self._blocks(ordinals)]

    # 7. footprints

    def _splat_footprints(self) -> None:
        book, (width, height) = self.book, self.book.size
        v = self.placing.down[:2] @ self.placing.down[:2].T
        if abs(v - book.zoom**2 * np.eye(2)).max() <= 1e-9 * book.zoom**2:
            v = book.zoom**2 * np.eye(2)
        squares, ways = np.linalg.eigh(v)
        squares = np.maximum(squares, 1)
        v = ways @ np.diag(squares) @ ways.T
        q = np.linalg.inv(v)
        amplitude = book.zoom**2 / sqrt(np.linalg.det(v))
        extent = [book.radius * sqrt(v[xy, xy]) for xy in range(2)]
        bits = self._offset_bits(extent, sqrt(squares.min()))
        profile = projection(book.kernel, book.radius)
        for ordinals in itertools.product(*map(range, self._counts)):
            shaded = self._shaded(ordinals)
            if shaded is None:
                continue
            place, threshold = self._place(ordinals)
            g = 6 - bits
            x, y = (((p + ((threshold << g) >> 32)) >> g) / 2**bits for p in place)
            left, right = max(0, floor(x - extent[0])), min(width, floor(x + extent[0]) + 2)
            top, bottom = max(0, floor(y - extent[1])), min(height, floor(y + extent[1]) + 2)
            if left >= right or top >= bottom:
                continue
            dx, dy = np.meshgrid(np.arange(left, right) - x, np.arange(top, bottom) - y)
            rho = np.sqrt(np.maximum(q[0, 0] * dx**2 + 2 * q[0, 1] * dx * dy + q[1, 1] * dy**2, 0))
            angle = np.arccos(np.minimum(rho / book.radius, 1))
            weight = amplitude * np.interp(angle, np.linspace(0, np.pi / 2, PROFILE), profile)
            self._combine((slice(top, bottom), slice(left, right)), weight, *shaded)

    def _offset_bits(self, extent: list[float], narrow: float) -> int:
        sample = self.axes[2]
        if abs(self.screen[1, sample]) > abs(self.screen[0, sample]):
            extent = extent[::-1]
        across, along = (max(1, ceil(2 * (e - 1e-9))) for e in extent)
        pitch = 32 if 16 < across <= 32 else -(-across // 4) * 4
        enough = max(3, ceil(log2(64 / narrow) - 1e-6))
        bits = 6
        while bits > enough and not self.book.precise and 4 * 4**bits * pitch * along > 1572864:
            bits -= 1
        while bits > 0 and 4 * 4**bits * pitch * along > 2**25:
            bits -= 1
        return bits

    # 8. cells

    def _splat_pixels(self) -> None:
        width, height = self.book.size
        for ordinals in itertools.product(*map(range, self._counts)):
            x, y = ((value + 2**31) // 2**32 for value in self.placing.fixed(self._doubled(ordinals)))
            shaded = self._shaded(ordinals)
            if shaded is not None and 0 <= x < width and 0 <= y < height:
                self._combine((slice(y, y + 1), slice(x, x + 1)), np.ones((1, 1)), *shaded)

    def _splat_cells(self) -> None:
        shaded = {n: self._shaded(n) for n in itertools.product(*map(range, self._counts))}
        towards = self.upwards[0] != self.book.front_to_back  # whether the sheet axis rises towards the viewer
        for sheet in range(self._counts[0]):
            low, high = self._visit(0, sheet)[1]
            far, near = (2 * low - 1, 2 * high - 1) if towards else (2 * high - 1, 2 * low - 1)
            for y, x in itertools.product(*map(range, self.buffer.shape[:2])):
                (far_row, far_sample), (near_row, near_sample) = (self._cell(x, y, m) for m in (far, near))
                way = [(far_row, far_sample), (near_row, far_sample), (near_row, near_sample)]
                for row, sample in reversed(way) if self.book.front_to_back else way:
                    found = shaded.get((sheet, row, sample))
                    if found is not None:
                        self._combine((slice(y, y + 1), slice(x, x + 1)), np.ones((1, 1)), *found)

    def _cell(self, x: int, y: int, doubled: int) -> tuple[int, int]:
        """Ordinals on the row and sample axes where a pixel's ray meets a plane of the sheet axis; -1 outside."""
        sheet, row, sample = self.axes
        (x_half, y_half), (x_zero, y_zero) = self.placing.half, self.placing.origin
        u, v = 2**32 * x - x_zero - doubled * x_half[sheet], 2**32 * y - y_zero - doubled * y_half[sheet]
        area = x_half[row] * y_half[sample] - y_half[row] * x_half[sample]
        at_row, at_sample = u * y_half[sample] - v * x_half[sample], v * x_half[row] - u * y_half[row]
        if area < 0:
            area, at_row, at_sample = -area, -at_row, -at_sample
        return self._ordinal(1, at_row, area), self._ordinal(2, at_sample, area)

    def _ordinal(self, loop: int, doubled: int, unit: int) -> int:
        """Of the block that holds the grid coordinate `doubled` / (2 `unit`)."""
        for n in range(self._counts[loop]):
            low, high = self._visit(loop, n)[1]
            if (2 * low - 1) * unit <= doubled < (2 * high - 1) * unit:
                return n
        return -1


def _visits(low: int, high: int, stride: int) -> list[tuple[int, tuple[int, int]]]:
    """The indices that a step visits on an axis, each with its block."""
    indices = [n for n in range(low, high) if n % stride == stride // 2] or [(low + high) // 2]
    begins = [low] + [n - stride // 2 for n in indices[1:]]
    return list(zip(indices, zip(begins, [*begins[1:], high], strict=True), strict=True))
