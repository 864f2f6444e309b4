"""What docs/how_it_works/image.md and slab_image.md make a picture of, in plain numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from by_the_book.tables import Patch, Points

Array = NDArray[np.float64]
Colours = tuple[Points, Points, Points]  # of red, green and blue


@dataclass
class Book:
    """All that decides a picture, in plain numbers; fields as on the page."""

    values: Array  # (k, j, i)
    to_physical: Array  # (3, 3), M
    window: tuple[float, float]
    strength_scale: float
    octahedral: bool
    step: str
    size: tuple[int, int]  # W, H
    rotation: tuple[float, float, float, float]  # x, y, z, w; up is +z
    zoom: float
    center: tuple[float, float, float]
    bounds: tuple[tuple[int, int, int], tuple[int, int, int]]
    front_to_back: bool
    kernel: str
    radius: float
    precise: bool
    emit: Colours
    refl: Colours
    opac: Points
    modu: Points
    patches: list[Patch]  # none: the four tables
    cross_bar: dict[str, str]  # of "emit", "refl", "opac", "modu"
    light: tuple[float, float, float]
    light_on_screen: bool
    emits: bool
    lit: tuple[bool, bool]  # diffuse, specular
    two_sided: bool
    power: float
    edges: bool
    factors: tuple[int, int, int] = (1, 1, 1)  # how many of the volume's voxels one has on each axis, if it is a level
    whole: tuple[int, int, int] | None = None  # the volume's, if it is a level


@dataclass(kw_only=True)
class SlabBook(Book):
    """What decides a picture of step G besides; its kernel is that of step G."""

    slab: float
    shadows: float
    occlusion: float
    depth_cue: float
    silhouettes: float
