"""Which side of a patient, or which end of the file's axes, lies towards each edge of a picture."""

from __future__ import annotations

from volsplat.client.figure.drawing import Anchor, Shape, Words
from volsplat.client.scene.view_sides import STANDPOINTS, sides
from volsplat.protocol.description.scene import Colour, Scene, View
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices

LEAST_PART = 0.35  # of a direction, for a side to be named: about 70 degrees away
MARGIN = 0.7  # ems from the edge

# Towards the edges, in screen axes: x to the right, y up.
EDGES = {"left": (-1.0, 0.0, 0.0), "right": (1.0, 0.0, 0.0), "top": (0.0, 1.0, 0.0), "bottom": (0.0, -1.0, 0.0)}


def edge_marks(view: View, description: VolumeDescription) -> dict[str, str]:
    """By edges: the sides that lie there, the nearest first, as "L" or "LA" of a patient."""
    marks = {name: side.mark for name, side in sides(description, view.up).items()}
    to_screen = matrices.rotation_from_quaternion(view.rotation)
    turned = {name: matrices.applied(to_screen, standpoint) for name, standpoint in STANDPOINTS.items()}
    between = "" if all(len(mark) == 1 for mark in marks.values()) else " "
    told = {}
    for edge, towards in EDGES.items():
        parts = {name: matrices.dot(direction, towards) for name, direction in turned.items()}
        near = sorted((name for name in parts if parts[name] >= LEAST_PART), key=lambda name: -parts[name])
        told[edge] = between.join(marks[name] for name in near)
    return told


def side_marks(
    scene: Scene, description: VolumeDescription, corner: tuple[int, int], em: int, ink: Colour, paper: Colour
) -> list[Shape]:
    """At the middles of the picture's edges; of a scene whose view is settled."""
    (x, y), image, margin = corner, scene.image, MARGIN * em
    rise = 0.36 * em  # half a capital letter
    places = {
        "left": (x + margin, y + image.height / 2 + rise, Anchor.START),
        "right": (x + image.width - margin, y + image.height / 2 + rise, Anchor.END),
        "top": (x + image.width / 2, y + margin + 2 * rise, Anchor.MIDDLE),
        "bottom": (x + image.width / 2, y + image.height - margin, Anchor.MIDDLE),
    }
    marks = edge_marks(scene.view, description)
    return [
        Words(left, base, marks[edge], em, ink, paper, anchor, bold=True)
        for edge, (left, base, anchor) in places.items()
        if marks[edge]
    ]
