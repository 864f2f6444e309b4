"""Divides the grid into sub-cubes, one box for each map/shade server."""

from volsplat.protocol.errors import BadInput
from volsplat.protocol.volume import Box, Geometry, Index


def divided(geometry: Geometry, parts: int) -> list[Box]:
    """`parts` boxes that partition the grid, as equal as whole voxels allow, by halving the longest edge.

    "Longest" is physical, so that the boxes stay compact on the screen. Raises BadInput where the volume has fewer
    voxels than there are parts.
    """
    if parts > geometry.box.voxels:
        raise BadInput(f"{parts} map/shade servers cannot share {geometry.box.voxels} voxels; start fewer")
    return _split(geometry.box, parts, geometry)


def _split(box: Box, parts: int, geometry: Geometry) -> list[Box]:
    if parts == 1:
        return [box]
    edges = [size * spacing if size > 1 else 0.0 for size, spacing in zip(box.size, geometry.spacing, strict=True)]
    axis = max((2, 1, 0), key=lambda a: edges[a])
    below = parts // 2
    # Enough voxels on both sides for their share of the parts.
    slab = box.voxels // box.size[axis]
    least, most = -(-below // slab), box.size[axis] - -(-(parts - below) // slab)
    cut = min(max(round(box.size[axis] * below / parts), least), most) + box.low[axis]
    lower, upper = _cut(box, axis, cut)
    return _split(lower, below, geometry) + _split(upper, parts - below, geometry)


def _cut(box: Box, axis: int, at: int) -> tuple[Box, Box]:
    def replaced(corner: Index) -> Index:
        i, j, k = (at if a == axis else corner[a] for a in range(3))
        return (i, j, k)

    return Box(box.low, replaced(box.high)), Box(replaced(box.low), box.high)
