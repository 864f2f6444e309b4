"""The legend of structure factors: a wheel of the colours that phases have, 0 degrees to the right, 90 at the top."""

import math

import numpy as np
from numpy.typing import NDArray

from volsplat.client.image.lettering import FONT, canvas_of, extent, pixels_of, write
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.description.volume import VolumeDescription

PHASE = "phase"  # what a description calls it
LAST = TABLE_ENTRIES - 1
SECTORS = 36  # of a wheel whose colours change steadily
INNER = 0.55  # of the outer radius
DEGREES = ("0°", "90°", "180°", "270°")
LABEL_SIZE = 0.1  # of the legend's side
LEAST_LABEL = 9  # pixels
LEAST_RING = 20  # pixels across, beside degrees
INK = 0.95  # grey of the degrees


def wheel_colours(description: VolumeDescription, scene: Scene) -> tuple[Colour, ...] | None:
    """The colours of equal sectors of phase, from 0 degrees up; None if the scene does not colour by phase."""
    if not scene.shading.emitted or scene.plane.patches:
        return None
    emitted, field = scene.tables.emit.entries(), scene.cross_bar.emit
    if field is Field.STRENGTH and description.strength_name == PHASE and description.second_scalar is not None:
        return tuple(emitted[round((n + 0.5) / SECTORS * LAST)] for n in range(SECTORS))
    if field is Field.DENSITY and description.kind is Kind.STRUCTURE_FACTORS and description.bands:
        return _of_bands(description, emitted)
    return None


def _of_bands(description: VolumeDescription, emitted: list[Colour]) -> tuple[Colour, ...] | None:
    """The one colour of each band; None if a band has several, or all have the same."""
    within = [{emitted[n] for n in range(int(band.low), min(int(band.high), LAST) + 1)} for band in description.bands]
    if any(len(colours) != 1 for colours in within) or len(set.union(*within)) == 1:
        return None
    return tuple(next(iter(colours)) for colours in within)


def phase_wheel(colours: tuple[Colour, ...], side: int) -> NDArray[np.float32]:
    """A ring of the colours, (side, side, 4) float32 with straight alpha, its edges smooth; clear elsewhere."""
    middle, outer = (side - 1) / 2, side / 2 - 1
    across = np.arange(side) - middle
    x, y = across[None, :], -across[:, None]
    radius = np.sqrt(x * x + y * y)
    turns = (np.arctan2(y, x) / (2 * math.pi)) % 1.0
    sector = np.minimum((turns * len(colours)).astype(int), len(colours) - 1)
    alpha = np.clip(outer + 0.5 - radius, 0, 1) * np.clip(radius - INNER * outer + 0.5, 0, 1)
    return np.dstack((np.array(colours)[sector], alpha)).astype(np.float32)


def phase_legend(colours: tuple[Colour, ...], side: int, paper: float = 0.0) -> NDArray[np.float32]:
    """The wheel with its degrees about it, (side, side, 3) float32, 0..1, on a grey `paper`, for a sheet or plate.

    Degrees that would leave too little of the wheel are left out.
    """
    text = max(round(LABEL_SIZE * side), LEAST_LABEL)
    widest = extent(DEGREES[2], text, FONT)
    beside_degrees = side - 2 * (widest + text // 4)
    labelled = beside_degrees >= LEAST_RING
    across = beside_degrees if labelled else side
    picture = np.full((side, side, 3), paper, np.float32)
    wheel, start = phase_wheel(colours, across), (side - across) // 2
    inside = picture[start : start + across, start : start + across]
    alpha = wheel[:, :, 3:]
    inside[:] = inside * (1 - alpha) + wheel[:, :, :3] * alpha
    if not labelled:
        return picture
    canvas, middle, end = canvas_of(picture), side // 2, start + across
    half = round(text * 0.36)  # of a digit's height
    for label, place in zip(
        DEGREES,
        ((end + text // 6, middle + half), (None, start - text // 5), (0, middle + half), (None, end + text)),
        strict=True,
    ):
        left, base = place
        write(canvas, middle - extent(label, text, FONT) // 2 if left is None else left, base, label, text, INK, FONT)
    return pixels_of(canvas)
