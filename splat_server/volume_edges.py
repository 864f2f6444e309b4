"""The white edges of the volume's box and of the clip box (paper: plates; design, section 5).

They depend on scene and geometry only, never on samples or their partition.
"""

from dataclasses import dataclass

from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.frame_plan import FIXED_ONE, FramePlan, plan_frame
from volsplat.splat_server._kernels import EdgeLayer

VOLUME_LINE_WIDTH = 1.5  # pixels
CLIP_LINE_WIDTH = 0.75


@dataclass(frozen=True)
class Edge:
    """A line between two points in pixels from the centre of the top-left one, y down."""

    begin: tuple[float, float]
    end: tuple[float, float]
    line_width: float  # pixels
    in_front: bool  # of all samples; else behind all of them


def volume_edges(scene: Scene, geometry: Geometry) -> list[Edge]:
    """The 12 edges of the volume's box, and those of the clip box where bounds are set; none if switched off.

    They are the volume's own, whatever step and level are drawn. Raises as plan_frame.
    """
    if not scene.image.edges:
        return []
    plan = plan_frame(scene, geometry, Step.F)
    edges = box_edges(geometry.box, plan, VOLUME_LINE_WIDTH)
    if plan.bounds != geometry.box:
        edges += box_edges(plan.bounds, plan, CLIP_LINE_WIDTH)
    return edges


def box_edges(box: Box, plan: FramePlan, line_width: float) -> list[Edge]:
    """The edges of a box of cells; corners lie at the cells' outer faces.

    An edge is behind when both its faces face away from the viewer. A face seen edge on does not.
    """
    # The outward normal of the upper face of a grid axis is that axis's row of the inverse.
    facing = tuple(row[2] for row in matrices.inverse(plan.pixels_per_index))
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
                        begin=_on_screen(plan, (corners[0][0], corners[0][1], corners[0][2])),
                        end=_on_screen(plan, (corners[1][0], corners[1][1], corners[1][2])),
                        line_width=line_width,
                        in_front=max(toward_viewer) >= 0,
                    )
                )
    return edges


def edge_layers(edges: list[Edge], width: int, height: int) -> tuple[EdgeLayer, EdgeLayer]:
    """The lines in front of all samples, and those behind."""
    front, back = EdgeLayer(width, height), EdgeLayer(width, height)
    for edge in edges:
        layer = front if edge.in_front else back
        layer.draw(*edge.begin, *edge.end, edge.line_width)
    return front, back


def _outer(box: Box, axis: int, upper: int) -> int:
    """The doubled index of a box's lower or upper face."""
    return 2 * box.high[axis] - 1 if upper else 2 * box.low[axis] - 1


def _on_screen(plan: FramePlan, doubled: Index) -> tuple[float, float]:
    return (plan.x.at_half_indices(doubled) / FIXED_ONE, plan.y.at_half_indices(doubled) / FIXED_ONE)
