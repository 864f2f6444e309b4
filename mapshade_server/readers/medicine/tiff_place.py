"""Where a TIFF file's voxels lie: their size by OME, ImageJ or the tags of resolution, and the tag Orientation."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.medicine.ome_tiff import OmeImage, StatedSteps
from volsplat.mapshade_server.readers.reading.grids import checked_geometry
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.length_units import length_unit

# Dots per inch that programs write when they know nothing of the specimen.
_SCREENS_AND_PRINTERS = (1, 72, 96, 100, 150, 200, 240, 300, 400, 600, 1200, 2400)
_MILLIMETRES_PER = {2: 25.4, 3: 10.0}  # the TIFF tag's inch and centimetre

# Where the stored rows and columns lead, by the tag Orientation: the axis of x (0) or y (1) of i and j, and the sign.
_LED_BY_ORIENTATION = {
    1: ((0, 1), (1, 1)),
    2: ((0, -1), (1, 1)),
    3: ((0, -1), (1, -1)),
    4: ((0, 1), (1, -1)),
    5: ((1, 1), (0, 1)),
    6: ((1, 1), (0, -1)),
    7: ((1, -1), (0, -1)),
    8: ((1, -1), (0, 1)),
}


@dataclass(frozen=True)
class Place:
    """What a file states of its voxels' size, and what had to be guessed."""

    steps: Vector
    unit: str
    warnings: tuple[str, ...]


def placed(path: Path, place: Place, packing: Any, dims: Index) -> Geometry:
    """Where i, j, k lead: x to the right, y down, z from slice to slice, whatever corner the pixels begin at."""
    steps = place.steps
    columns = [[0.0] * 3, [0.0] * 3, [0.0, 0.0, steps[2]]]
    origin = [0.0] * 3
    orientation = packing.tags.valueof(274, 1)
    for n, (axis, sign) in enumerate(_LED_BY_ORIENTATION.get(orientation, _LED_BY_ORIENTATION[1])):
        columns[n][axis] = sign * steps[axis]
        if sign < 0:
            origin[axis] = (dims[n] - 1) * steps[axis]
    return checked_geometry(path, dims, np.transpose(columns), origin)


def stated_place(file: Any, packing: Any, image: OmeImage | None, kept_in: str) -> Place:
    if image is not None:
        return _place(image.steps, image.unit)
    if file.is_imagej:
        said = file.imagej_metadata or {}
        unit = str(said.get("unit", "")).encode("latin-1", "ignore").decode("unicode_escape")
        x, y = _resolutions(packing)
        between = said.get("spacing")
        z = abs(float(between)) if between else None
        known = length_unit(unit)
        return _place((1 / x if x else None, 1 / y if y else None, z), known.symbol if known else "")
    place = _plain_place(packing)
    if kept_in:
        told = f"the metadata of this OME-TIFF is in {kept_in}, which volsplat does not read: steps are not known"
        return Place(place.steps, place.unit, (*place.warnings, told))
    return place


def _plain_place(packing: Any) -> Place:
    """The pixels' size by the tags of resolution, unless they are those of a screen or a printer."""
    per = _MILLIMETRES_PER.get(packing.tags.valueof(296, 2))
    x, y = _resolutions(packing)
    if per is None or not x or not y or round(x * 25.4 / per, 2) in _SCREENS_AND_PRINTERS:
        ratio = x / y if x and y else 1.0
        return Place((1.0, ratio, 1.0), "", ())
    return _place((per / x, per / y, None), "mm")


def _resolutions(packing: Any) -> tuple[float, float]:
    """Pixels per unit along x and y, 0 if the page states none."""
    values = (packing.tags.valueof(282, (0, 1)), packing.tags.valueof(283, (0, 1)))
    x, y = (top / bottom if bottom else 0.0 for top, bottom in values)
    return x, y


def _place(stated: StatedSteps, unit: str) -> Place:
    """The steps as stated, the others as wide as a pixel, with a warning."""
    x, y, z = stated
    if x is None:
        told = () if (y, z) == (None, None) else ("the file states no width of its pixels: taken as 1",)
        return Place((1.0, 1.0 if y is None else y, 1.0 if z is None else z), "", told)
    missing = [name for name, step in (("height of its pixels", y), ("distance of its slices", z)) if step is None]
    told = (f"the file states no {' and no '.join(missing)}: taken as the width of a pixel",) if missing else ()
    return Place((x, x if y is None else y, x if z is None else z), unit, told)
