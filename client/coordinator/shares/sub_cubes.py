"""Divides the grid into sub-cubes, one box for each map/shade server."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from volsplat.protocol.description.volume import MOST_VOXELS, Box, Geometry, Index

MOST_READ_TWICE = 0.25  # of a box that is cut; along another axis nothing may have to be
ALMOST = 1 - 1e-6  # edges count as equal within it: spacings of turned volumes are rounded


class Share(NamedTuple):
    """What one map/shade server may get."""

    speed: float = 1.0  # in any unit
    most: int = MOST_VOXELS  # voxels


class Work(Protocol):
    """How much there is to do where."""

    def along(self, box: Box, axis: int) -> list[tuple[int, float]]:
        """Of layers of a box that follow each other along an axis: where each ends, and its work."""


class Even:
    """As if all voxels were alike."""

    def along(self, box: Box, axis: int) -> list[tuple[int, float]]:
        return [(box.high[axis], 1.0)]


def divided(geometry: Geometry, parts: int, chunk: Index = (1, 1, 1)) -> list[Box]:
    """So many boxes that partition the grid, or as many as it has voxels, as equal as these allow."""
    return divided_box(geometry, geometry.box, parts, chunk)


def divided_by_work(geometry: Geometry, shares: Sequence[Share], chunk: Index, work: Work) -> list[Box]:
    """A box for each share, which partition the grid: the longest edge is cut, over and over, where the work is shared.

    There may be no more shares than voxels.

    "Longest" is physical, so that the boxes stay compact on the screen, and that of boxes of equal volume: whatever the
    work is the same axes are cut, so that other work moves cuts, and little changes hands. Of equal edges k is the last
    to be cut: most volumes stand upright on it, and seen from around their rows of samples run along it, which are best
    left whole. An edge is left alone, while there are others, where much on both sides of the cut would be read twice,
    since only `chunk` voxels along i, j, k come together from the file: its rows for one that is raw, which are not cut
    across. Nobody gets more voxels than fit, where those on both sides of a cut have room for theirs.
    """
    return _Division(geometry, chunk, work).split(geometry.box, geometry.box, shares)


def divided_box(geometry: Geometry, box: Box, parts: int, chunk: Index) -> list[Box]:
    """A box of the grid in so many parts of its own, or as many as it has voxels."""
    return _Division(geometry, chunk, Even()).split(box, box, [Share()] * min(parts, box.voxels))


class _Division(NamedTuple):
    geometry: Geometry
    chunk: Index
    work: Work

    def split(self, box: Box, even: Box, shares: Sequence[Share]) -> list[Box]:
        """`even` is what the box would be if all shares and all work were alike."""
        if len(shares) == 1:
            return [box]
        if not any(min(sizes) > 1 for sizes in zip(box.size, even.size, strict=True)):
            even = box
        axis, half = self._axis(box, even), len(shares) // 2
        layer = box.voxels // box.size[axis]
        at = self._place(box, axis, shares[:half], shares[half:])
        room_below, room_above = (at - box.low[axis]) * layer, (box.high[axis] - at) * layer
        below = min(max(half, len(shares) - room_above), room_below)  # no more shares than voxels on either side
        even_at = even.low[axis] + _within(even, axis, round(even.size[axis] * half / len(shares)))
        (lower, upper), (even_lower, even_upper) = box.cut(axis, at), even.cut(axis, even_at)
        return self.split(lower, even_lower, shares[:below]) + self.split(upper, even_upper, shares[below:])

    def _axis(self, box: Box, even: Box) -> int:
        """The one to cut."""
        sizes = [(min(pair), pair[1]) for pair in zip(box.size, even.size, strict=True)]
        steps = self.geometry.spacing
        edges = [size * step if least > 1 else 0.0 for (least, size), step in zip(sizes, steps, strict=True)]
        cheap = [n <= MOST_READ_TWICE * size for n, size in zip(self.chunk, even.size, strict=True)]
        if any(edge and free for edge, free in zip(edges, cheap, strict=True)):
            edges = [edge if free else 0.0 for edge, free in zip(edges, cheap, strict=True)]
        longest = max(edges) * ALMOST
        return next(axis for axis in (1, 0, 2) if edges[axis] >= longest)

    def _place(self, box: Box, axis: int, below: Sequence[Share], above: Sequence[Share]) -> int:
        """Where on an axis the box is cut between those who get what is below and above."""
        low, layer = box.low[axis], box.voxels // box.size[axis]
        speeds = [sum(share.speed for share in side) for side in (below, above)]
        cut = round(_reached(self.work.along(box, axis), low, speeds[0] / sum(speeds)) - low)
        least, most = box.size[axis] - _room(above) // layer, _room(below) // layer
        return low + _within(box, axis, min(max(cut, least), most) if least <= most else cut)


def _room(shares: Sequence[Share]) -> int:
    return sum(share.most for share in shares)


def _within(box: Box, axis: int, cut: int) -> int:
    """The cut, so that something is left on either side."""
    return min(max(cut, 1), box.size[axis] - 1)


def _reached(layers: list[tuple[int, float]], start: int, part: float) -> float:
    """Where this part of the layers' work is done."""
    left = part * sum(work for _, work in layers)
    if not left:
        return start + (layers[-1][0] - start) * part
    for end, work in layers:
        if work >= left:
            return start + (end - start) * left / work
        start, left = end, left - work
    return start
