"""Bars of round lengths at the lower left of a picture."""

from __future__ import annotations

import math

from volsplat.client.figure.drawing import Pen, Shape
from volsplat.client.volume.scales import Scale, round_length, scale_text, scales_of
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.rules.resolved_view import resolved_zoom, screen_rotation

LEAST_SHARE = math.sin(math.radians(20))  # on the screen, of an axis' length: no bar for one nearer the line of sight
LONGEST = 0.28  # of the picture's width
MARGIN = 0.9  # ems from its edges
THICKNESS = 0.22  # ems
WORDS = 0.5  # ems from a bar up to the words' base line
ROW = 1.9  # ems from bar to bar


def bar_length(scale: Scale, scene: Scene, description: VolumeDescription) -> tuple[float, float]:
    """Units of the scale, a round number of them, and the pixels that these span.

    Along the scale's axis if it has one, as this lies on the screen; else along what lies across the line of sight.
    """
    geometry = description.geometry
    per_unit = scale.length * resolved_zoom(scene, geometry) / geometry.reference_spacing
    per_unit *= _share_on_screen(scale, scene, geometry)
    length = round_length(LONGEST * scene.image.width / per_unit)
    return length, length * per_unit


def is_seen(scale: Scale, scene: Scene, geometry: Geometry) -> bool:
    """Whether it is not that of an axis along which one looks; of a scene whose view is settled."""
    return _share_on_screen(scale, scene, geometry) >= LEAST_SHARE


def _share_on_screen(scale: Scale, scene: Scene, geometry: Geometry) -> float:
    if scale.axis is None:
        return 1.0
    along = matrices.column(matrices.product(screen_rotation(scene.view), geometry.index_to_physical), scale.axis)
    return math.hypot(along[0], along[1]) / matrices.length(along)


def scale_bars(scene: Scene, description: VolumeDescription, corner: tuple[int, int], pen: Pen) -> list[Shape]:
    """One for each scale that is seen of the volume, the first at the top; `corner` is the picture's.

    Each has a row of its own, seen or not, so that in a movie none moves as another comes and goes.
    """
    shapes: list[Shape] = []
    scales = scales_of(description)
    left = corner[0] + MARGIN * pen.em
    for n, scale in enumerate(scales):
        if not is_seen(scale, scene, description.geometry):
            continue
        length, pixels = bar_length(scale, scene, description)
        y = corner[1] + scene.image.height - (MARGIN + ROW * (len(scales) - 1 - n)) * pen.em
        shapes.append(pen.words(left, y - WORDS * pen.em, scale_text(scale, length)))
        shapes.append(pen.line(left, y, left + pixels, y, THICKNESS))
    return shapes
