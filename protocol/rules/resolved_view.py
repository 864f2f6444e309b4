"""What a scene leaves open, decided for a volume: bounds, centre, zoom and order; and how its axes are turned."""

import math
from functools import lru_cache

from volsplat.protocol.description.scene import Order, Scene, View
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.geometry.upright import upright
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA

FIT_FRACTION = 0.98  # of the image's shorter side, for the ball that a fit shows: without a volume's data all of it


def screen_rotation(view: View) -> Matrix:
    """The rotation from physical to screen axes."""
    return matrices.product(matrices.rotation_from_quaternion(view.rotation), upright(view.up))


def resolved_bounds(scene: Scene, geometry: Geometry) -> Box:
    """The scene's bounds with -1 replaced. Raises ValueError naming the axis where they leave the volume."""
    low = scene.bounds.low
    high = tuple(n if h == -1 else h for h, n in zip(scene.bounds.high, geometry.dims, strict=True))
    for axis, name in enumerate("ijk"):
        if not 0 <= low[axis] < high[axis] <= geometry.dims[axis]:
            raise ValueError(
                f"bounds on {name} are {low[axis]}..{high[axis]}, but the volume has {name} from 0 to "
                f"{geometry.dims[axis]}; give low < high within that range"
            )
    return Box(low, (high[0], high[1], high[2]))


def resolved_center(scene: Scene, geometry: Geometry) -> Vector:
    if scene.view.center != "middle":
        return scene.view.center
    ni, nj, nk = geometry.dims
    return ((ni - 1) / 2, (nj - 1) / 2, (nk - 1) / 2)


def resolved_zoom(scene: Scene, geometry: Geometry) -> float:
    """Pixels per reference spacing; "fit" puts the volume's bounding sphere inside the image."""
    if scene.view.zoom != "fit":
        return scene.view.zoom
    return zoom_showing_all(geometry, scene.image.width, scene.image.height)


def zoom_showing_all(geometry: Geometry, width: int, height: int) -> float:
    """At which the volume's bounding sphere fits into an image of so many pixels; pixels per reference spacing."""
    diameter = 2 * bounding_radius(geometry) / geometry.reference_spacing
    return FIT_FRACTION * min(width, height) / diameter


def resolved_order(scene: Scene, geometry: Geometry) -> Order:
    """Back-to-front or front-to-back, for all steps alike; the faster one where the scene leaves it open.

    Front to back what is hidden is skipped, but each sample costs a little more: it is slower where the whole
    volume at the tables' greatest opacity would still hide nothing.
    """
    if scene.order != Order.FASTEST:
        return scene.order
    greatest = _greatest_opacity(scene)
    thickest = 2 * bounding_radius(geometry) / geometry.reference_spacing
    hides = greatest >= 1.0 or -math.log1p(-greatest) * thickest >= -math.log(1.0 - FROZEN_ALPHA)
    return Order.FRONT_TO_BACK if hides else Order.BACK_TO_FRONT


def _greatest_opacity(scene: Scene) -> float:
    """No sample's is greater."""
    if scene.plane.patches:
        return scene.plane.greatest
    greatest = scene.tables.opac.greatest
    return greatest * scene.tables.modu.greatest if scene.shading.modulation else greatest


@lru_cache(maxsize=16)
def bounding_radius(geometry: Geometry) -> float:
    """The radius of the sphere around the middle of the volume that holds all its cells, in physical units."""
    ni, nj, nk = geometry.dims
    m = geometry.index_to_physical
    corners = [matrices.applied(m, (ni / 2, sj * nj / 2, sk * nk / 2)) for sj in (-1.0, 1.0) for sk in (-1.0, 1.0)]
    return max(matrices.length(corner) for corner in corners)
