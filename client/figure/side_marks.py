"""Which side of a patient, or which end of the file's axes, lies towards each edge of a picture."""

from __future__ import annotations

from collections.abc import Iterator

from volsplat.client.figure.drawing import Anchor, Pen, Shape
from volsplat.client.figure.room import Room
from volsplat.client.scene.view_sides import STANDPOINTS, sides
from volsplat.protocol.description.scene import Image, Scene, View
from volsplat.protocol.description.volume import VolumeDescription
from volsplat.protocol.geometry import matrices

LEAST_PART = 0.35  # of a direction, for a side to be named: about 70 degrees away
MARGIN = 0.7  # ems from the edge
STEP = 0.5  # ems from one place that is tried to the next

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
    scene: Scene, description: VolumeDescription, room: Room, corner: tuple[int, int], pen: Pen
) -> list[Shape]:
    """At the picture's edges, as near their middles as there is room, which they take; a mark without any is left out.

    The scene's view is settled.
    """
    marks = edge_marks(scene.view, description)
    shapes: list[Shape] = []
    for edge, mark in marks.items():
        if not mark:
            continue
        best = room.best(
            (pen.words(left, base, mark, anchor, bold=True),)
            for left, base, anchor in _places(edge, scene.image, corner, pen.em)
        )
        if not room.trouble(best).covered:
            room.take(best)
            shapes += best
    return shapes


def _places(edge: str, image: Image, corner: tuple[int, int], em: int) -> Iterator[tuple[float, float, Anchor]]:
    """Along an edge, from its middle to its ends."""
    (x, y), margin = corner, MARGIN * em
    rise = 0.36 * em  # half a capital letter
    along = image.height if edge in ("left", "right") else image.width
    for step in range(round(along / (2 * STEP * em)) + 1):
        for aside in {step * STEP * em: None, -step * STEP * em: None}:
            middle, level = x + image.width / 2 + aside, y + image.height / 2 + rise + aside
            match edge:
                case "left":
                    yield x + margin, level, Anchor.START
                case "right":
                    yield x + image.width - margin, level, Anchor.END
                case "top":
                    yield middle, y + margin + 2 * rise, Anchor.MIDDLE
                case _:
                    yield middle, y + image.height - margin, Anchor.MIDDLE
