"""What scenes that are made here share: tables by points, and the light."""

from volsplat.protocol.description.colours import colour_from_hex
from volsplat.protocol.description.scene import ColourTable, Light, ScalarTable

KEY_LIGHT = Light(direction=(0.35, 0.45, 1.0))  # a little from the right and above, so that form casts shade
GLOW, REFLECTION = 0.35, 0.75  # of a colour, if a surface both glows and reflects


def colours(*points: tuple[float, str]) -> ColourTable:
    return ColourTable(points=tuple((position, colour_from_hex(colour)) for position, colour in points))


def scalars(*points: tuple[float, float]) -> ScalarTable:
    return ScalarTable(points=points)


def dimmed(table: ColourTable, factor: float) -> ColourTable:
    return ColourTable(
        points=tuple((position, (r * factor, g * factor, b * factor)) for position, (r, g, b) in table.points)
    )


def both_sides(zero: float, clear: float, strongest: float) -> ScalarTable:
    """Opacity that grows with the distance from `zero` on both sides, beyond the share `clear` of it."""
    below, above = zero * (1 - clear), zero + (1 - zero) * clear
    return scalars((0.0, strongest), (below, 0.0), (above, 0.0), (1.0, strongest))
