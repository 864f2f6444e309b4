"""What of a volume can be seen under a scene's tables and bounds, and the view that fits it into the image.

Known by blocks (protocol/description/block_extremes.py): one is visible if the opacities of the densities between its
least and its greatest value are. What little lies about the rest does not count: noise, and faint sheets and threads,
such as a scanner's headrest. Of a still its outline fills the image; of what turns the ball about the middle of its box
does, which is the same from each side.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from volsplat.client.scene.resized import allowed_zoom
from volsplat.client.volume.visible_blocks import block_shares, opacities
from volsplat.protocol.description.block_extremes import BlockExtremes, block_size
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.resolved_view import FIT_FRACTION, resolved_bounds, screen_rotation

FAINT = 0.01  # opacity: less is hardly seen
FAINT_SHARE = 0.1  # of the greatest opacity: nor is less than that, in a scene that is faint altogether
STRAY = 0.01  # of the visible blocks: so many that have no visible neighbour may be noise, and are left out
SOLID_SHARE = 0.25  # of what the block shows that shows most: at least as much is solid, less is faint
NEAR = 2  # blocks: so near to one with visible ones all around it is no thin sheet or thread, but its rim
ASIDE = 0.01  # of all that blocks show: so much that is faint and thin may be what lies about, and is left out

OUTLINE_FRACTION = 0.94  # of the image's width or height, for the outline of a still

Blocks = NDArray[np.bool_]  # (k, j, i)
Points = NDArray[np.float64]  # (n, 3)
Indices = NDArray[np.int64]  # (n, 3) of i, j, k
CORNERS = np.array(list(product((0, 1), repeat=3)))  # of a box: whether each is at its end along i, j, k


class Extent(NamedTuple):
    """What is to fill the image: its middle, physical, how far it reaches from there, and how much it is to fill."""

    centre: Vector
    across: float
    upwards: float
    fraction: float


def fitting_view(scene: Scene, geometry: Geometry, extent: Extent) -> tuple[float, Vector]:
    """Zoom and centre at which voxel centres of this extent, with their footprints, just fit into the scene's image."""
    radius = scene.reconstruction.radius
    footprint = DEFAULT_RADIUS[scene.reconstruction.kernel] if radius == "default" else radius
    voxel = _longest_step(geometry)

    def scale(side: int, reach: float) -> float:
        """Pixels per unit of length."""
        half = extent.fraction * side / 2
        scale = half / (reach + footprint * voxel)
        if scale * voxel < 1.0 and half > footprint and reach > 0.0:  # footprints are then widened to pixels
            scale = min(scale, (half - footprint) / reach)
        return scale

    least = min(scale(scene.image.width, extent.across), scale(scene.image.height, extent.upwards))
    zoom = allowed_zoom(least * geometry.reference_spacing)
    return zoom, matrices.applied(matrices.inverse(geometry.index_to_physical), extent.centre)


def extent_from(view: View, geometry: Geometry, points: Points) -> Extent:
    """Of these points as they are seen: the outline's."""
    rotation = np.array(screen_rotation(view))
    seen: Points = points @ rotation.T
    centre = _centre(view, geometry, _middle(seen) @ rotation)
    across, upwards, _ = np.abs(seen - rotation @ centre).max(axis=0).tolist()
    return Extent(centre, across, upwards, OUTLINE_FRACTION)


def extent_in_a_turn(view: View, geometry: Geometry, points: Points) -> Extent:
    """Of these points from each side: the ball's about the middle of their box, or about the view's centre if given."""
    centre = _centre(view, geometry, _middle(points))
    reach = _reach(centre, points)
    return Extent(centre, reach, reach, FIT_FRACTION)


def _centre(view: View, geometry: Geometry, middle: Points) -> Vector:
    """The view's, which may be this middle of what is visible."""
    if view.center == "middle":
        return _vector(middle)
    return matrices.applied(geometry.index_to_physical, view.center)


def visible_points(scene: Scene, geometry: Geometry, quantisation: Quantisation, extremes: BlockExtremes) -> Points:
    """Corners of boxes about the visible voxels' centres, physical, none of which lies outside of all boxes.

    They lie relative to the centre of voxel (0, 0, 0): with an origin far away added, places would be rounded.
    Where nothing is visible, of all within the bounds; white edges are visible, too. Raises ValueError for bounds
    that the volume does not have.
    """
    bounds = resolved_bounds(scene, geometry)
    first, shares = block_shares(_seen(scene), geometry.dims, bounds, quantisation, extremes)
    blocks = _that_count(shares)
    corners = _corners(first, blocks, geometry.dims, bounds) if blocks.any() else _corners_of(*_lone(bounds))
    if scene.image.edges:
        corners = np.concatenate((corners, _corners_of(*_lone(geometry.box))))
    return _physical(geometry, corners)


def _longest_step(geometry: Geometry) -> float:
    """No unit step of the grid, in whichever direction, is longer: the norm of the matrix is at most this."""
    m = geometry.index_to_physical
    by_rows = max(sum(abs(part) for part in row) for row in m)
    by_columns = max(sum(abs(part) for part in row) for row in matrices.transposed(m))
    return float((by_rows * by_columns) ** 0.5)


def _seen(scene: Scene) -> list[float]:
    """The opacity of each density byte that can well be seen. Indexed by another field, it may be anything."""
    known = opacities(scene)
    if known is None:
        return [1.0] * TABLE_ENTRIES
    least = min(FAINT, FAINT_SHARE * max(known))
    return [opacity if opacity > least else 0.0 for opacity in known]


def _that_count(shares: NDArray[np.float64]) -> Blocks:
    """The visible blocks without the faint and thin, and then those that stand alone, unless such make up much."""
    visible = shares > 0.0
    thick = _within(_within(~visible, 1) == 0, NEAR) > 0
    aside = visible & ~thick & (shares < SOLID_SHARE * shares.max())
    if shares[aside].sum() <= ASIDE * shares.sum():
        visible = visible & ~aside
    strays = visible & (_within(visible, 1) == 1)
    return visible & ~strays if strays.sum() <= STRAY * visible.sum() else visible


def _within(blocks: Blocks, reach: int) -> NDArray[np.intp]:
    """How many of them lie in the cube about each that reaches so many blocks to each side."""
    counts = np.pad(blocks.astype(np.intp), reach)
    for axis in range(3):
        counts = sliding_window_view(counts, 2 * reach + 1, axis).sum(axis=-1)
    return counts


def _corners(first: Index, blocks: Blocks, dims: Index, bounds: Box) -> Indices:
    """Grid points about all voxel centres of the blocks within the bounds; `first` is the one at their corner."""
    k, j = np.nonzero(blocks.any(axis=2))
    rows = blocks[k, j]
    low = np.stack((rows.argmax(axis=1), j, k), axis=1) + first
    high = np.stack((rows.shape[1] - 1 - rows[:, ::-1].argmax(axis=1), j, k), axis=1) + first
    size = block_size(dims)
    return _corners_of(np.maximum(low * size, bounds.low), np.minimum((high + 1) * size, bounds.high))


def _lone(box: Box) -> tuple[Indices, Indices]:
    return np.atleast_2d(box.low), np.atleast_2d(box.high)


def _corners_of(low: Indices, high: Indices) -> Indices:
    """Eight of each box."""
    return np.stack((low, high - 1), axis=1)[:, CORNERS, np.arange(3)].reshape(-1, 3)


def _physical(geometry: Geometry, indices: Indices) -> Points:
    """Where each is from voxel (0, 0, 0), by the very operations of `matrices`."""
    i, j, k = indices.T.astype(np.float64)
    return np.stack([a * i + b * j + c * k for a, b, c in geometry.index_to_physical], axis=1)


@np.errstate(over="ignore")  # of grids as wide as numbers are
def _reach(centre: Vector, points: Points) -> float:
    """How far away the farthest point is, by the very operations of `matrices`."""
    off: Points = points - centre
    x, y, z = off.T
    return math.sqrt((x * x + y * y + z * z).max())


def _middle(points: Points) -> NDArray[np.float64]:
    """Of the box about them."""
    middle: NDArray[np.float64] = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle


def _vector(point: NDArray[np.float64]) -> Vector:
    x, y, z = point.tolist()
    return (x, y, z)
