"""The white edges of the volume's box and of the clip box (paper: plates; design, section 5).

They depend on scene and geometry only, never on samples or their partition.
"""

import math

import msgspec

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.grid_on_screen import FIXED_ONE, LARGEST_POSITION, GridOnScreen, grid_on_screen
from volsplat.protocol.rules.resolved_view import resolved_bounds

VOLUME_LINE_WIDTH = 1.5  # pixels
CLIP_LINE_WIDTH = 0.75
MOST_EDGES = 24

Point = tuple[float, float]


class Edge(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A line between two points in pixels from the centre of the top-left one, y down."""

    begin: Point
    end: Point
    line_width: float  # pixels
    in_front: bool  # of all samples; else behind all of them

    def __post_init__(self) -> None:
        if not all(abs(place) <= 2 * LARGEST_POSITION for place in (*self.begin, *self.end)):
            raise ValueError(f"an edge must lie near the image, not from {self.begin} to {self.end}")
        if not (math.isfinite(self.line_width) and 0 < self.line_width <= VOLUME_LINE_WIDTH):
            raise ValueError(f"an edge's line is above 0 and at most {VOLUME_LINE_WIDTH} pixels, not {self.line_width}")


def volume_edges(scene: Scene, geometry: Geometry) -> tuple[Edge, ...]:
    """The 12 edges of the volume's box, and those of the clip box where bounds are set; none if switched off.

    They are the volume's own, whatever step and level are drawn. Raises as grid_on_screen and resolved_bounds.
    """
    if not scene.image.edges:
        return ()
    grid, bounds = grid_on_screen(scene, geometry), resolved_bounds(scene, geometry)
    edges = _box_edges(geometry.box, grid, VOLUME_LINE_WIDTH)
    if bounds != geometry.box:
        edges += _box_edges(bounds, grid, CLIP_LINE_WIDTH)
    return tuple(edges)


def _box_edges(box: Box, grid: GridOnScreen, line_width: float) -> list[Edge]:
    """The edges of a box of cells; corners lie at the cells' outer faces.

    An edge is behind when both its faces face away from the viewer. A face seen edge on does not.
    """
    # The outward normal of the upper face of a grid axis is that axis's row of the inverse.
    facing = tuple(row[2] for row in matrices.inverse(grid.pixels_per_index))
    x, y = grid.x, grid.y

    def on_screen(corner: list[int]) -> Point:
        doubled: Index = (corner[0], corner[1], corner[2])
        return (x.at_half_indices(doubled) / FIXED_ONE, y.at_half_indices(doubled) / FIXED_ONE)

    edges = []
    for axis in range(3):
        first, second = [other for other in range(3) if other != axis]
        for at_first in (0, 1):
            for at_second in (0, 1):
                corners = [[0, 0, 0], [0, 0, 0]]
                for end in (0, 1):
                    corners[end][axis] = _outer(box, axis, end)
                    corners[end][first] = _outer(box, first, at_first)
                    corners[end][second] = _outer(box, second, at_second)
                toward_viewer = (facing[first] * (1 if at_first else -1), facing[second] * (1 if at_second else -1))
                edges.append(
                    Edge(
                        begin=on_screen(corners[0]),
                        end=on_screen(corners[1]),
                        line_width=line_width,
                        in_front=max(toward_viewer) >= 0,
                    )
                )
    return edges


def _outer(box: Box, axis: int, upper: int) -> int:
    """The doubled index of a box's lower or upper face."""
    return 2 * box.high[axis] - 1 if upper else 2 * box.low[axis] - 1
