"""A scene's tables under another window: where the same densities lie, so that keys of a movie can be compared."""

from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ColourTable, Field, ScalarTable

Window = tuple[float, float]
Point = tuple[float, tuple[float, ...]]  # a position 0..1, and numbers


class _Moved(NamedTuple):
    """From positions under one window to those under another."""

    scale: float
    shift: float

    def points(self, points: Sequence[Point]) -> list[Point]:
        """As many; those that come to lie outside stand at the table's end, with what the table has there."""
        moved = []
        for place, numbers in points:
            wanted = place * self.scale + self.shift
            kept = min(max(wanted, 0.0), 1.0)
            moved.append((kept, numbers if kept == wanted else _at((kept - self.shift) / self.scale, points)))
        return moved

    def colours(self, table: ColourTable) -> ColourTable:
        return ColourTable(points=tuple((place, (r, g, b)) for place, (r, g, b) in self.points(table.points)))

    def scalars(self, table: ScalarTable) -> ScalarTable:
        points = [(place, (value,)) for place, value in table.points]
        return ScalarTable(points=tuple((place, value) for place, (value,) in self.points(points)))


def in_window(scene: Scene, window: Window, other: Window) -> Scene:
    """The scene of tables under one window with those that go by density as they are under another."""
    (low, high), (other_low, other_high) = window, other
    moved = _Moved((high - low) / (other_high - other_low), (low - other_low) / (other_high - other_low))
    tables, by = scene.tables, scene.cross_bar
    return msgspec.structs.replace(
        scene,
        tables=msgspec.structs.replace(
            tables,
            emit=moved.colours(tables.emit) if by.emit is Field.DENSITY else tables.emit,
            refl=moved.colours(tables.refl) if by.refl is Field.DENSITY else tables.refl,
            opac=moved.scalars(tables.opac) if by.opac is Field.DENSITY else tables.opac,
            modu=moved.scalars(tables.modu) if by.modu is Field.DENSITY else tables.modu,
        ),
    )


def _at(place: float, points: Sequence[Point]) -> tuple[float, ...]:
    """What a table has there: by straight lines between points, and beyond them as the last one."""
    right = next((n for n, (position, _) in enumerate(points) if position > place), len(points))
    if right in (0, len(points)):
        return points[min(right, len(points) - 1)][1]
    (p0, first), (p1, second) = points[right - 1], points[right]
    part = (place - p0) / (p1 - p0)
    return tuple(a * (1 - part) + b * part for a, b in zip(first, second, strict=True))
