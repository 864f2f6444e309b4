"""Words that point at voxels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

from volsplat.client.figure.drawing import Anchor, Line, Pen, Shape, Words
from volsplat.client.figure.room import Room
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.grid_on_screen import grid_on_screen

REACH = 1.6  # ems from the voxel to the words, aside and upwards
THICKNESS = 0.1  # ems

Ways = dict[int, tuple[float, float]]  # of each label: from its voxel to its words, in pixels to the right and down


def place_of(point: Vector, scene: Scene, geometry: Geometry) -> tuple[float, float]:
    """Where a grid point lies, in pixels from the picture's upper left corner."""
    on_screen = grid_on_screen(scene, geometry)
    x, y, _ = matrices.plus(matrices.applied(on_screen.pixels_per_index, point), on_screen.origin)
    return x + 0.5, y + 0.5


def why_unlabelled(labels: Sequence[tuple[str, Vector]], scene: Scene, volume: SurveyedVolume) -> str:
    """One line that names the labels whose voxels lie outside the picture; empty if none do."""
    return _absence("the figure lacks", "outside the picture", labels, [scene], volume)


def why_never_labelled(labels: Sequence[tuple[str, Vector]], scenes: Sequence[Scene], volume: SurveyedVolume) -> str:
    """Likewise of those that a movie never shows."""
    return _absence("no image of the movie has", "outside all of them", labels, scenes, volume)


def _absence(
    lacks: str,
    outside: str,
    labels: Sequence[tuple[str, Vector]],
    scenes: Sequence[Scene],
    volume: SurveyedVolume,
) -> str:
    settled, geometry = [volume.settled(scene) for scene in scenes], volume.description.geometry

    def is_seen(point: Vector) -> bool:
        return any(_is_inside(*place_of(point, scene, geometry), scene.image) for scene in settled)

    absent = [text for text, point in labels if not is_seen(point)]
    if not absent:
        return ""
    which, points = ("label", "it points") if len(absent) == 1 else ("labels", "they point")
    size = " x ".join(map(str, geometry.dims))
    return (
        f"{lacks} the {which} {', '.join(absent)}: what {points} at lies {outside}; give voxels of the volume "
        f"({size}), or turn or zoom the view"
    )


def _is_inside(x: float, y: float, image: Image) -> bool:
    return 0 <= x <= image.width and 0 <= y <= image.height


def pointing_labels(
    labels: Sequence[tuple[str, Vector]],
    scene: Scene,
    geometry: Geometry,
    room: Room,
    corner: tuple[int, int],
    pen: Pen,
    ways: Ways,
) -> list[Shape]:
    """Where there is room, which they take; those of voxels outside the picture are left out.

    A label goes the way that it went last, if nothing is wrong there now; `ways` is brought up to date.
    """
    shapes: list[Shape] = []
    for n, (text, point) in enumerate(labels):
        x, y = place_of(point, scene, geometry)
        if not _is_inside(x, y, scene.image):
            continue
        tried = chain([ways[n]] if n in ways else [], _ways(x, y, scene.image, pen.em))
        start = (x + corner[0], y + corner[1])
        line, _ = best = room.best(_pointing(text, start, way, pen) for way in tried)
        ways[n] = (line.x1 - line.x0, line.y1 - line.y0)
        room.take(best)
        shapes += best
    return shapes


def _pointing(text: str, start: tuple[float, float], way: tuple[float, float], pen: Pen) -> tuple[Line, Words]:
    end, side = (start[0] + way[0], start[1] + way[1]), 1 if way[0] > 0 else -1
    anchor = Anchor.START if side > 0 else Anchor.END
    words = pen.words(end[0] + 0.25 * pen.em * side, end[1] + 0.36 * pen.em, text, anchor)
    return pen.line(*start, *end, THICKNESS), words


def _ways(x: float, y: float, image: Image, em: int) -> Iterator[tuple[float, float]]:
    """From a voxel to words aslant of it, the nearest first; of these upwards, towards the picture's middle."""
    reach = REACH * em
    aside, down = 1 if x < image.width / 2 else -1, -1 if y > 2 * reach else 1
    farthest = max(round(min(image.width, image.height) / reach), 1)
    diagonals = [(aside, down), (aside, -down), (-aside, down), (-aside, -down)]
    return ((n * reach * right, n * reach * below) for n in range(1, farthest + 1) for right, below in diagonals)
