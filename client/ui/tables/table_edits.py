"""What can be done to a table at once: ramps, steps, inversion and the like, and the thinning of a freehand curve.

Pure functions from table to table of the same kind; every result is a valid table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.patches import Patches
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, ScalarTable

LAST = TABLE_ENTRIES - 1
FREEHAND_BOUND = 1 / 512  # half a level of 8 bits: what thinning may change in any entry
MOST_STEPS = 64

Table = ColourTable | ScalarTable
Channels = tuple[float, ...]  # the value of a scalar table's point, or a colour


def table_from_points(like: Table, points: object, drawn: bool = False) -> Table:
    """A table of the same kind from untrusted points [[position, value or [r, g, b]], ...]. Raises ValueError.

    A curve that was `drawn` freehand is simplified.
    """
    try:
        table = msgspec.convert({"points": points}, type(like))
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from error
    return simplified(table) if drawn else table


def ramp(table: Table, rising: bool = True) -> Table:
    """From 0 to 1, or from black to white; falling the other way."""
    first, last = (0.0, 1.0) if rising else (1.0, 0.0)
    channels = len(_channels(table)[0][1])
    return _table(table, [(0.0, (first,) * channels), (1.0, (last,) * channels)])


def steps(table: Table, bands: int) -> Table:
    """The table in `bands` bands of equal width, each with the value at its middle. Raises ValueError."""
    if not 2 <= bands <= MOST_STEPS:
        raise ValueError(f"steps must be 2 to {MOST_STEPS}, not {bands}")
    points: list[tuple[float, Channels]] = []
    for band in range(bands):
        value = value_at(table, (band + 0.5) / bands)
        points += [(band / bands, value), ((band + 1) / bands, value)]
    return _table(table, points)


def constant(table: Table, value: Channels) -> Table:
    """The same value everywhere: (v,) for a scalar table, (r, g, b) for one of colours."""
    return _table(table, [(0.0, value)])


def inverted(table: Table) -> Table:
    """1 minus every value."""
    return _mapped(table, lambda value: 1.0 - value)


def mirrored(table: Table) -> Table:
    """Left and right exchanged."""
    return _table(table, [(1.0 - position, value) for position, value in reversed(_channels(table))])


def with_greatest(table: ScalarTable, greatest: float) -> Table:
    """The table scaled so that its greatest value is `greatest`; one that is 0 everywhere stays so."""
    now = table.greatest
    return _mapped(table, lambda value: value / now * greatest) if now > 0 else table


def patches_with_greatest(patches: Patches, greatest: float) -> Patches:
    """The patches with opacities scaled so that the greatest is `greatest`; if all are 0 they stay so."""
    now = max(patch.opacity for patch in patches)
    if now == 0:
        return patches
    return tuple(msgspec.structs.replace(patch, opacity=patch.opacity / now * greatest) for patch in patches)


def shifted(table: Table, by: float) -> Table:
    """The table moved along its axis by a share of it: what leaves the axis is cut off, the ends go on as they were."""
    if by == 0:
        return table
    points = [(round(position + by, 6), value) for position, value in _channels(table)]
    kept = [(position, value) for position, value in points if 0 <= position <= 1]
    if points[0][0] < 0:
        kept.insert(0, (0.0, value_at(table, -by)))
    if points[-1][0] > 1:
        kept.append((1.0, value_at(table, 1 - by)))
    return _table(table, kept)


def simplified(table: Table) -> Table:
    """Fewer points, at some of the 256 entries; no channel of any entry changes by more than FREEHAND_BOUND."""
    entries = [_as_channels(entry) for entry in table.entries()]
    kept = [0, LAST]
    spans = [(0, LAST)]
    while spans:
        first, last = spans.pop()
        worst, off = _worst_between(entries, first, last)
        if off > FREEHAND_BOUND:
            kept.append(worst)
            spans += [(first, worst), (worst, last)]
    return _table(table, [(n / LAST, entries[n]) for n in sorted(kept)])


def value_at(table: Table, position: float) -> Channels:
    """The channels of a table between its entries, at a position 0..1."""
    points = _channels(table)
    right = next((n for n, (at, _) in enumerate(points) if at > position), len(points))
    if right == 0:
        return points[0][1]
    if right == len(points):
        return points[-1][1]
    (low, below), (high, above) = points[right - 1], points[right]
    share = (position - low) / (high - low)
    return tuple(b + (a - b) * share for b, a in zip(below, above, strict=True))


def _worst_between(entries: list[Channels], first: int, last: int) -> tuple[int, float]:
    """The entry that lies farthest off the straight line from entry `first` to `last`, and how far."""
    worst, farthest = first, 0.0
    for n in range(first + 1, last):
        share = (n - first) / (last - first)
        ends = zip(entries[first], entries[last], entries[n], strict=True)
        off = max(abs(low + (high - low) * share - value) for low, high, value in ends)
        if off > farthest:
            worst, farthest = n, off
    return worst, farthest


def _as_channels(value: float | Colour) -> Channels:
    return value if isinstance(value, tuple) else (value,)


def _channels(table: Table) -> list[tuple[float, Channels]]:
    return [(position, _as_channels(value)) for position, value in table.points]


def _table(like: Table, points: Sequence[tuple[float, Channels]]) -> Table:
    if isinstance(like, ScalarTable):
        return ScalarTable(points=tuple((position, value) for position, (value,) in points))
    return ColourTable(points=tuple((position, (r, g, b)) for position, (r, g, b) in points))


def _mapped(table: Table, function: Callable[[float], float]) -> Table:
    return _table(table, [(at, tuple(function(channel) for channel in value)) for at, value in _channels(table)])
