"""Section 5 of docs/how_it_works/image.md: colour and opacity of a voxel."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from by_the_book.book import Book
from by_the_book.placing import Placing, rounded
from by_the_book.tables import patched, table
from by_the_book.voxels import directions

Array = NDArray[np.float64]


class Shading:
    """Tables of 256 entries, what indexes them, and light."""

    def __init__(self, book: Book, placing: Placing) -> None:
        self.book, self.placing = book, placing
        self.tables = {name: table(getattr(book, name)) for name in ("opac", "modu")}
        for name in ("emit", "refl"):
            self.tables[name] = np.stack([table(channel) for channel in getattr(book, name)], axis=1)
        light = np.array(book.light) / np.linalg.norm(book.light)
        self.to_light = placing.turn.T @ light if book.light_on_screen else light  # L
        self.to_viewer = placing.turn.T @ np.array([0.0, 0.0, 1.0])  # E
        self.physical = book.to_physical / np.linalg.norm(book.to_physical, axis=0)
        of_codes = directions(book.octahedral)
        self.light = self.light_on(of_codes)
        self.gradient_bytes = self.bytes_of_directions(of_codes)

    def light_on(self, direction: Array) -> Array:
        """Of unit vectors, or zeros: (n, 3)."""
        half = self.to_light + self.to_viewer
        half = half / np.linalg.norm(half) if half.any() else half
        x, y, z = -direction.T
        towards_light, towards_half = (x * v[0] + y * v[1] + z * v[2] for v in (self.to_light, half))
        if self.book.two_sided:
            towards_light, towards_half = abs(towards_light), abs(towards_half)
        glint = np.where(towards_light > 0, np.maximum(towards_half, 0) ** self.book.power, 0)
        light: Array = self.book.lit[0] * np.maximum(towards_light, 0) + self.book.lit[1] * glint
        return np.where(direction.any(axis=1), light, 0)

    def bytes_of_directions(self, direction: Array) -> NDArray[np.int64]:
        """Along i, j and k: (n, 3)."""
        found: NDArray[np.int64] = np.floor(128.5 + 127 * direction @ self.physical).astype(np.int64)
        return found

    def of_voxel(self, index: tuple[int, int, int], doubled: Sequence[int], packet: int) -> tuple[float, Array, Array]:
        """Opacity, emitted and reflected colour."""
        if self.book.patches:
            opacity, emit, refl = patched(self.book.patches, np.array([packet & 255]), packet >> 8 & 255)
            return float(opacity[0]), emit[0] * self.book.emits, refl[0]
        byte = {name: self._field(field, index, doubled, packet) for name, field in self.book.cross_bar.items()}
        a = float(self.tables["opac"][byte["opac"]] * self.tables["modu"][byte["modu"]])
        return a, self.tables["emit"][byte["emit"]], self.tables["refl"][byte["refl"]]

    def _field(self, name: str, index: tuple[int, int, int], doubled: Sequence[int], packet: int) -> int:
        kind, _, axis = name.partition("-")
        if kind in ("density", "strength"):
            return packet >> (8 if kind == "strength" else 0) & 255
        if kind == "grid":
            n = "ijk".index(axis)
            return int(256 * self.placing.in_volume(np.array(index))[n] // self.placing.whole[n])
        if kind == "gradient":
            return int(self.gradient_bytes[packet >> 16 & 0x7FFF]["ijk".index(axis)])
        at_zero, *halves = self.screen_field("xyz".index(axis))
        value = at_zero + sum(d * half for d, half in zip(doubled, halves, strict=True))
        return min(max(value >> 32, 0), 255)

    def screen_field(self, axis: int) -> tuple[int, int, int, int]:
        """In 2^-32: at grid point 0, and what half a step of i, j and k adds."""
        row = self.placing.screen[axis] * 128 / self.placing.ball
        i, j, k = (rounded(2.0**31 * step) for step in row)
        return rounded(2.0**32 * (128 - float(row @ self.placing.middle))), i, j, k
