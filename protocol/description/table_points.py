"""The points of a table, (position 0..1, value): their checks, and the entries between them."""

from volsplat.protocol.description.scene_key import check_within


def check_positions(positions: list[float]) -> None:
    """Raises ValueError if they cannot be a table's."""
    if not positions:
        raise ValueError("a table needs at least one point")
    for position in positions:
        check_within("a point's position", position)
    if any(later < earlier for earlier, later in zip(positions, positions[1:], strict=False)):
        raise ValueError(f"points must be in rising order of position, not {positions}")


def interpolated(points: list[tuple[float, float]], count: int) -> list[float]:
    """The table's `count` entries at positions n / (count - 1), by straight lines between points."""
    entries = []
    right = 0
    for n in range(count):
        position = n / (count - 1)
        while right < len(points) and points[right][0] <= position:
            right += 1
        if right == 0:
            entries.append(points[0][1])
        elif right == len(points):
            entries.append(points[-1][1])
        else:
            (p0, v0), (p1, v1) = points[right - 1], points[right]
            entries.append(v0 + (v1 - v0) * ((position - p0) / (p1 - p0)))
    return entries
