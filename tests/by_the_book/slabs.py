"""A renderer of step G written from docs/how_it_works/slab_image.md alone: section numbers are that page's."""

import itertools
from functools import cache
from math import ceil, floor, log2, sqrt

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import SlabBook
from by_the_book.edges import between_edges
from by_the_book.kernels import kernel, over_the_ball
from by_the_book.placing import Placing, rounded
from by_the_book.shading import Shading
from by_the_book.slab_light import MOST_OPAQUE, BlockLight
from by_the_book.tables import patched
from by_the_book.voxels import packed

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Codes = NDArray[np.int64]

POLYNOMIALS = {
    "balanced": (0.6903, -3.0395, 3.7758, -0.2857, -1.9475),
    "crisp": (0.7955, -3.6648, 4.6524, -0.3571, -2.4344),
    "quasi-interpolating": (0.7479, -8.0007, 29.0489, -50.7137, 47.0686, -22.0338, 4.0465),
}
RADII = {"balanced": 2.0, "crisp": 2.0, "quasi-interpolating": 3.0, "gaussian": 2.0}
OTHER_RADIUS = 1.75


def draw_slabs(book: SlabBook) -> Array:
    """The image (H, W, 4)."""
    return _Slabs(book).drawn()


class _Slabs:
    def __init__(self, book: SlabBook) -> None:
        self.book = book
        self.placing = Placing(book)
        self.shading = Shading(book, self.placing)
        self.light = BlockLight(book, self.placing, self.shading)
        self.packets = packed(book.values, book.to_physical, book.window, book.strength_scale, book.octahedral)
        self._place_planes()
        self.reach = max(1, int(np.rint(book.zoom / 2)))  # beta
        self._sum_densities()

    # 1. planes

    def _place_planes(self) -> None:
        screen = self.placing.screen
        self.apart = self.book.slab * self.book.zoom  # Z
        self.away = -screen[2] / self.apart  # D
        self.mu = float(self.away @ self.placing.middle)
        low, high = self.book.bounds
        corners = [
            float(self.away @ [(a - 0.5, b - 0.5)[end] for a, b, end in zip(low, high, ends, strict=True)]) - self.mu
            for ends in itertools.product((0, 1), repeat=3)
        ]
        self.first = floor(min(corners))  # F
        self.planes = ceil(max(corners)) + 1 - self.first  # P
        self.to_grid = np.linalg.inv(np.vstack([screen[:2], self.away]))

    def _placed(self, index: tuple[int, int, int]) -> tuple[float, float, float]:
        """Pixels right and down, planes away."""
        bits = min(max(ceil(log2(16 / self.book.zoom)), 0), 4)
        doubled = [2 * n for n in index]
        fine = [(value + 2**25) // 2**26 for value in self.placing.fixed(doubled)]
        x, y = ((p + 2 ** (5 - bits)) // 2 ** (6 - bits) / 2**bits for p in fine)
        depth = rounded(-(2.0**32) * (self.mu + self.first))
        depth += sum(d * rounded(2.0**31 * away) for d, away in zip(doubled, self.away, strict=True))
        return x, y, (depth + 2**28) // 2**29 / 8

    # 2. densities

    def _sum_densities(self) -> None:
        """On planes -1 to P, with pixels around the image that gradients reach."""
        book, margin = self.book, self.reach
        v = self.placing.screen @ self.placing.screen.T
        squares, ways = np.linalg.eigh(v[:2, :2])
        w = v.copy()
        w[:2, :2] = ways @ np.diag(np.maximum(squares, 1)) @ ways.T
        w[2, 2] = max(v[2, 2], self.apart**2)
        gain = sqrt(np.linalg.det(v) / np.linalg.det(w))
        inverse = np.linalg.inv(w)
        sharp = book.kernel in POLYNOMIALS
        unit = 2**26 if gain < 0.25 else 1200 if sharp else 3000
        scale = unit * gain / _integral(book.kernel)
        reach = [RADII.get(book.kernel, OTHER_RADIUS) * sqrt(w[a, a]) for a in range(3)]
        reach[2] /= self.apart
        width, height = book.size
        box = ((-1, self.planes + 1), (-margin, height + margin), (-margin, width + margin))
        sums = np.zeros((2, *(high - low for low, high in box)))
        for k, j, i in np.ndindex(self.packets.shape):
            packet = int(self.packets[k, j, i])
            if packet >> 31:
                continue
            place = self._placed((i, j, k))[::-1]
            ranges = [
                (max(low, floor(at - far)), min(high, floor(at + far) + 2))
                for at, far, (low, high) in zip(place, reach[::-1], box, strict=True)
            ]
            if any(low >= high for low, high in ranges):
                continue
            dp, dy, dx = np.meshgrid(*(np.arange(*r) - at for r, at in zip(ranges, place, strict=True)), indexing="ij")
            o = np.stack([dx, -dy, -self.apart * dp])
            rho = np.sqrt(np.maximum(np.einsum("a...,ab,b...->...", o, inverse, o), 0))
            weight = np.floor(scale * _kernel(book.kernel, rho) + 0.5)
            where = tuple(slice(a - low, b - low) for (a, b), (low, _) in zip(ranges, box, strict=True))
            sums[0][where] += weight
            sums[1][where] += weight * (packet & 255)
        self.known = sums[0] >= floor(unit * (3 if sharp else 1) / 16)
        self.density = np.clip(sums[1] / np.where(self.known, sums[0], 1), 0, 255)

    # 3. a slab in a pixel

    def drawn(self) -> Array:
        width, height = self.book.size
        image = np.zeros((height * width, 4))
        for slab in range(self.planes - 1):
            opacity, colour = self._slab(slab)
            source = np.column_stack([colour, np.ones(len(colour))])
            added = image + (1 - image[:, 3:]) * opacity[:, None] * source
            image = np.where(image[:, 3:] >= 1 - 1 / 1024, image, added)
        whole = image.reshape(height, width, 4)
        return between_edges(whole, self.book, self.placing) if self.book.edges else whole

    def _plane(self, plane: int) -> tuple[Array, Flags]:
        """Densities of the image's pixels, and which are known."""
        inner = (plane + 1, slice(self.reach, -self.reach), slice(self.reach, -self.reach))
        return self.density[inner].ravel(), self.known[inner].ravel()

    def _slab(self, slab: int) -> tuple[Array, Array]:
        (front, front_known), (back, back_known) = self._plane(slab), self._plane(slab + 1)
        front, back = np.where(front_known, front, back), np.where(back_known, back, front)
        t0, t1 = self._ends(slab)
        there = (front_known | back_known) & (t0 < t1)
        t0, t1 = np.where(there, t0, 0), np.where(there, t1, 1)
        d0, d1 = (front + t * (back - front) for t in (t0, t1))
        on_front, on_back = self._gradients(slab)
        g0, g1 = (on_front + t[:, None] * (on_back - on_front) for t in (t0, t1))
        gradient = (g0 + g1) / 2
        grid = self._grid(slab, (t0 + t1) / 2)
        bytes_of = self._fields(d0, d1, gradient, grid)
        depths, colours_by = self._depths(bytes_of)
        low, high, shares = _span(d0, d1)
        depth = self.book.slab * self.placing.thickness * (t1 - t0) * (shares * depths).sum(axis=1)
        emit, refl = (self._colour(name, shares * colours_by, bytes_of) for name in ("emit", "refl"))
        emit = emit * self.book.emits
        share_lit, lit = self._lit(shares * colours_by, low, high, d1 < d0, depth, g0, g1)
        direct, around = self._dimmed(grid, gradient)
        cue, edge = self._cues(grid, gradient)
        colour = emit + refl * (share_lit * lit * direct)[:, None]
        colour = np.clip(colour * (cue * edge * around)[:, None], 0, 1)
        return np.where(there, -np.expm1(-depth), 0), colour

    def _grid(self, slab: int, t: Array) -> Array:
        """Grid coordinates (n, 3) of the image's pixels."""
        width, height = self.book.size
        y, x = (a.ravel() for a in np.mgrid[:height, :width])
        right = x - (width - 1) / 2
        up = (height - 1) / 2 - y
        c = np.array(self.book.center)
        to_solve = np.stack([right, up, slab + t + self.mu + self.first - float(self.away @ c)], axis=1)
        found: Array = to_solve @ self.to_grid.T + c
        return found

    def _ends(self, slab: int) -> tuple[Array, Array]:
        zero = np.zeros(self.book.size[0] * self.book.size[1])
        start, end = self._grid(slab, zero), self._grid(slab, zero + 1)
        t0, t1 = zero, zero + 1
        for axis, (low, high) in enumerate(zip(*self.book.bounds, strict=True)):
            way = end[:, axis] - start[:, axis]
            still = way == 0
            way = np.where(still, 1, way)
            one, other = ((face - 0.5 - start[:, axis]) / way for face in (low, high))
            inside = (start[:, axis] >= low - 0.5) & (start[:, axis] <= high - 0.5)
            t0 = np.maximum(t0, np.where(still, np.where(inside, 0, 2), np.minimum(one, other)))
            t1 = np.minimum(t1, np.where(still, np.where(inside, 1, -2), np.maximum(one, other)))
        return t0, t1

    def _gradients(self, slab: int) -> tuple[Array, Array]:
        """On the front and the back plane, along physical axes."""
        sideways = [self._sideways(plane) for plane in (slab, slab + 1)]
        known = [self._plane(plane)[1][:, None] for plane in (slab, slab + 1)]
        front = np.where(known[0], sideways[0], sideways[1])
        back = np.where(known[1], sideways[1], sideways[0])
        both = []
        for plane, across in ((slab, front), (slab + 1, back)):
            along = self._away(plane, slab)
            seen = np.column_stack([across[:, 0], -across[:, 1], -along / self.apart])
            both.append(seen @ self.placing.turn * self.book.zoom / self.placing.spacing)
        return both[0], both[1]

    def _sideways(self, plane: int) -> Array:
        density, known, reach = self.density[plane + 1], self.known[plane + 1], self.reach
        inner = (slice(reach, -reach), slice(reach, -reach))
        found = []
        for axis in (1, 0):
            ends = []
            for sign in (-1, 1):
                shifted, there = (np.roll(a, -sign * reach, axis)[inner] for a in (density, known))
                ends.append((np.where(there, shifted, density[inner]), there))
            (before, left), (after, right) = ends
            found.append(((after - before) / np.where(left & right, 2 * reach, reach)).ravel())
        return np.stack(found, axis=1)

    def _away(self, plane: int, slab: int) -> Array:
        (before, before_known), (after, after_known) = self._plane(plane - 1), self._plane(plane + 1)
        (front, front_known), (back, back_known) = self._plane(slab), self._plane(slab + 1)
        both = front_known & back_known
        one_sided = np.where(both, back - front, 0)
        return np.where(before_known & after_known & both, (after - before) / 2, one_sided)

    def _fields(self, d0: Array, d1: Array, gradient: Array, grid: Array) -> dict[str, Codes]:
        book, placing = self.book, self.placing
        found: dict[str, Array | Codes] = {"density": np.clip((d0 + d1) / 2 + 0.5, 0, 255)}
        size = np.linalg.norm(gradient, axis=1)
        low, high = book.window
        found["strength"] = np.minimum(255, size * book.strength_scale * (high - low) / 255) + 0.5
        of_direction = self.shading.bytes_of_directions(_unit(gradient))
        screen = self._on_screen(grid)
        nearest = np.clip(np.floor(grid + 0.5 + 2.0**-20), 0, np.array(placing.dims) - 1).astype(np.int64)
        voxel = placing.in_volume(nearest)
        for n, axis in enumerate("ijk"):
            found[f"grid-{axis}"] = 256 * voxel[:, n] // placing.whole[n]
            found[f"gradient-{axis}"] = of_direction[:, n]
        for n, axis in enumerate("xyz"):
            found[f"screen-{axis}"] = np.clip(screen[:, n], 0, 255)
        return {name: np.floor(values).astype(np.int64) for name, values in found.items()}

    def _on_screen(self, grid: Array) -> Array:
        """Screen x, y and z as fields, not rounded."""
        columns = []
        for axis in range(3):
            at_zero, *halves = self.shading.screen_field(axis)
            columns.append((at_zero + grid @ (2.0 * np.array(halves))) / 2**32)
        return np.stack(columns, axis=1)

    def _depths(self, bytes_of: dict[str, Codes]) -> tuple[Array, Array]:
        """Of each pixel's 256 entries: delta, and delta' that weights colours."""
        if self.book.patches:
            depths = _depth(self._patched(bytes_of["strength"])[0])
            return depths, depths
        by_density: Array = np.ones((1, 256))
        others = np.ones((len(bytes_of["density"]), 1))
        for name in ("opac", "modu"):
            entries, field = self.shading.tables[name], self.book.cross_bar[name]
            if field == "density" or np.ptp(entries) == 0:
                by_density = by_density * entries
            else:
                others = others * entries[bytes_of[field]][:, None]
        return _depth(by_density * others), _depth(by_density)

    def _patched(self, strength: Codes) -> tuple[Array, Array, Array]:
        """Rows of the plane: opacities (n, 256), colours (n, 256, 3)."""
        found, which = np.unique(strength, return_inverse=True)
        rows = [patched(self.book.patches, np.arange(256), int(s)) for s in found]
        a, emit, refl = (np.array([row[part] for row in rows])[which] for part in range(3))
        return a, emit, refl

    def _colour(self, name: str, weights: Array, bytes_of: dict[str, Codes]) -> Array:
        if self.book.patches:
            entries = self._patched(bytes_of["strength"])[1 if name == "emit" else 2]
            single = entries[np.arange(len(weights)), bytes_of["density"]]
            sums = np.einsum("nd,ndc->nc", weights, entries)
        else:
            entries, field = self.shading.tables[name], self.book.cross_bar[name]
            single = entries[bytes_of[field]]
            if field != "density":
                return single
            sums = weights @ entries
        total = weights.sum(axis=1)[:, None]
        return np.where(total < 1e-12, single, sums / np.where(total < 1e-12, 1, total))

    def _lit(
        self, weights: Array, low: Array, high: Array, falls: Flags, depth: Array, g0: Array, g1: Array
    ) -> tuple[Array, Array]:
        """What share of what is seen is lit, and light there."""
        total = weights.sum(axis=1)
        middle = (weights * (np.arange(256) + 0.5)).sum(axis=1) / np.where(total < 1e-12, 1, total)
        v = np.where(total < 1e-12, 0.5, np.clip((middle - low) / (high - low), 0, 1))
        k = np.where(falls, 1 - v, v)
        half = np.maximum(np.minimum(k, 1 - k), 5e-7)
        begin = k - half
        x0, x1 = np.zeros(len(k)), np.ones(len(k))
        if not self.book.two_sided:
            at0, at1 = (-g @ self.shading.to_light for g in (g0, g1))
            turns = at0 * at1 < 0
            turn = at0 / np.where(turns, at0 - at1, 1)
            turn = np.clip((turn - begin) / (2 * half), 0, 1)
            x0 = np.where(turns & (at0 <= 0), turn, x0)
            x1 = np.where(turns & (at0 > 0), turn, x1)
        some = depth > 0
        seen = np.where(some, np.expm1(-depth), 1)
        share = np.where(some, (np.expm1(-depth * x1) - np.expm1(-depth * x0)) / seen, 0)
        y = begin + 2 * half * (x0 + (x1 - x0) * _eta(depth * (x1 - x0)))
        return share, self.shading.light_on(_unit(g0 + y[:, None] * (g1 - g0)))

    def _dimmed(self, grid: Array, gradient: Array) -> tuple[Array, Array]:
        """What shadows and what occlusion leave."""
        outwards = -_unit(gradient)
        from_light = self.light.at(self.light.from_light, grid, outwards)
        from_around = self.light.at(self.light.from_around, grid, outwards)
        return (
            1 - self.book.shadows * (1 - from_light),
            1 - self.book.occlusion * (1 - np.minimum(1, 2 * from_around)),
        )

    def _cues(self, grid: Array, gradient: Array) -> tuple[Array, Array]:
        unit = _unit(gradient)
        near = self._on_screen(grid)[:, 2] / 256
        cue = 1 - self.book.depth_cue * (1 - np.clip(near, 0, 1))
        turned = 1 - self.book.silhouettes * (1 - abs(unit @ self.shading.to_viewer)) ** 2
        return cue, np.where(unit.any(axis=1), turned, 1)


def _span(d0: Array, d1: Array) -> tuple[Array, Array, Array]:
    """Where it begins and ends, and the shares of 256 entries."""
    c, e = (d0 + d1) / 2 + 0.5, np.maximum(0.5, abs(d1 - d0) / 2)
    low, high = np.clip(c - e, 0, 255.5), np.clip(c + e, 0.5, 256)
    n = np.arange(256)
    covered = np.minimum(high[:, None], n + 1) - np.maximum(low[:, None], n)
    return low, high, np.maximum(covered, 0) / (high - low)[:, None]


def _depth(opacity: Array) -> Array:
    depth: Array = -np.log(1 - np.minimum(opacity, MOST_OPAQUE))
    return depth


def _eta(t: Array) -> Array:
    safe = np.where(t < 1e-4, 1, np.minimum(t, 700))
    return np.where(t < 1e-4, 0.5 - t / 12, 1 / safe - 1 / np.expm1(safe))


def _unit(gradient: Array) -> Array:
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    return np.where(length < 1e-9, 0, gradient / np.where(length < 1e-9, 1, length))


def _kernel(name: str, r: Array) -> Array:
    radius = RADII.get(name, OTHER_RADIUS)
    if name in POLYNOMIALS:
        q = (r / radius) ** 2
        value = (1 - q) ** 2 * np.polynomial.polynomial.polyval(q, POLYNOMIALS[name])
    else:
        value = kernel(name, r, radius)
    return np.where(r < radius, value, 0)


@cache
def _integral(name: str) -> float:
    radius = RADII.get(name, OTHER_RADIUS)
    return over_the_ball(lambda r: _kernel(name, r), radius)
