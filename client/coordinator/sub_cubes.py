"""Divides the grid into sub-cubes, one box for each map/shade server."""

from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.text.errors import BadInput

MOST_READ_TWICE = 0.25  # of a box that is cut; along another axis nothing may have to be
ALMOST = 1 - 1e-6  # edges count as equal within it: spacings of turned volumes are rounded


def divided(geometry: Geometry, parts: int, chunk: Index = (1, 1, 1)) -> list[Box]:
    """`parts` boxes that partition the grid, as equal as whole voxels allow, by halving the longest edge.

    "Longest" is physical, so that the boxes stay compact on the screen. Of equal edges k is the last to be halved: most
    volumes stand upright on it, and seen from around their rows of samples run along it, which are best left whole.
    An edge is left alone, while there are others, where much on both sides of the cut would be read twice, since only
    `chunk` voxels along i, j, k come together from the file: its rows for one that is raw, which are not cut across.
    Raises BadInput where the volume has fewer voxels than there are parts.
    """
    if parts > geometry.box.voxels:
        raise BadInput(f"{parts} map/shade servers cannot share {geometry.box.voxels} voxels; start fewer")
    return _split(geometry.box, parts, geometry, chunk)


def _split(box: Box, parts: int, geometry: Geometry, chunk: Index) -> list[Box]:
    if parts == 1:
        return [box]
    edges = [size * spacing if size > 1 else 0.0 for size, spacing in zip(box.size, geometry.spacing, strict=True)]
    cheap = [n <= MOST_READ_TWICE * size for n, size in zip(chunk, box.size, strict=True)]
    if any(edge and free for edge, free in zip(edges, cheap, strict=True)):
        edges = [edge if free else 0.0 for edge, free in zip(edges, cheap, strict=True)]
    longest = max(edges) * ALMOST
    axis = next(a for a in (1, 0, 2) if edges[a] >= longest)
    size, slab = box.size[axis], box.voxels // box.size[axis]
    half = parts // 2
    cut = min(max(round(size * half / parts), 1), size - 1)
    below = min(max(half, parts - (size - cut) * slab), cut * slab)  # no more parts than voxels on either side
    lower, upper = _cut(box, axis, box.low[axis] + cut)
    return _split(lower, below, geometry, chunk) + _split(upper, parts - below, geometry, chunk)


def _cut(box: Box, axis: int, at: int) -> tuple[Box, Box]:
    def replaced(corner: Index) -> Index:
        i, j, k = (at if a == axis else corner[a] for a in range(3))
        return (i, j, k)

    return Box(box.low, replaced(box.high)), Box(replaced(box.low), box.high)
