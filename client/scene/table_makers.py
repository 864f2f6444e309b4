"""What scenes that are made here share: tables by points, and the light."""

from collections.abc import Sequence

import numpy as np

from volsplat.protocol.description.colours import colour_from_hex
from volsplat.protocol.description.scene import Light
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, ScalarTable

KEY_LIGHT = Light(direction=(0.35, 0.45, 1.0))  # a little from the right and above, so that form casts shade
ENTRY = 1 / (TABLE_ENTRIES - 1)  # from one of a table to the next
GLOW, REFLECTION = 0.35, 0.75  # of a colour, if a surface both glows and reflects


def colours(*points: tuple[float, str]) -> ColourTable:
    """Points that lie beyond the table are put at its ends."""
    return ColourTable(points=tuple((_on_table(place), colour_from_hex(colour)) for place, colour in points))


def scalars(*points: tuple[float, float]) -> ScalarTable:
    return ScalarTable(points=points)


def opacities(*points: tuple[float, float]) -> ScalarTable:
    """Opacities by density, whose points may lie beyond the table, since the window begins or ends between them.

    The first entry is that of all densities below the window, too, and the last that of all above. If opacity begins
    clear below the window that entry stays clear, or the air around a body would be as opaque as what the window begins
    with; the next one has that. So at the end.
    """
    first, last = points[0], points[-1]
    kept = [(_on_table(place), opacity) for place, opacity in points]
    if first[0] < 0.0 and first[1] == 0.0:
        kept = [(0.0, 0.0), (ENTRY, _value_at(0.0, points)), *(point for point in kept if point[0] > ENTRY)]
    if last[0] > 1.0 and last[1] == 0.0:
        before = (point for point in kept if point[0] < 1.0 - ENTRY)
        kept = [*before, (1.0 - ENTRY, _value_at(1.0, points)), (1.0, 0.0)]
    return scalars(*kept)


def _on_table(place: float) -> float:
    return min(max(place, 0.0), 1.0)


def _value_at(place: float, points: Sequence[tuple[float, float]]) -> float:
    places, values = zip(*points, strict=True)
    return float(np.interp(place, places, values))


def dimmed(table: ColourTable, factor: float) -> ColourTable:
    return ColourTable(
        points=tuple((position, (r * factor, g * factor, b * factor)) for position, (r, g, b) in table.points)
    )


def both_sides(zero: float, clear: float, strongest: float) -> ScalarTable:
    """Opacity that grows with the distance from `zero` on both sides, beyond the share `clear` of it."""
    below, above = zero * (1 - clear), zero + (1 - zero) * clear
    return scalars((0.0, strongest), (below, 0.0), (above, 0.0), (1.0, strongest))
