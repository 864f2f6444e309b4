"""The white edges as two layers of coverage that the published image lies between."""

from collections.abc import Iterable

from volsplat.protocol.rules.volume_edges import Edge
from volsplat.splat_server._kernels import EdgeLayer


def edge_layers(edges: Iterable[Edge], width: int, height: int) -> tuple[EdgeLayer, EdgeLayer]:
    """The lines in front of all samples, and those behind."""
    front, back = EdgeLayer(width, height), EdgeLayer(width, height)
    for edge in edges:
        layer = front if edge.in_front else back
        layer.draw(*edge.begin, *edge.end, edge.line_width)
    return front, back
