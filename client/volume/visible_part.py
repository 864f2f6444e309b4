"""What of a volume can be seen under a scene's tables and bounds, and the view that fits it into the image.

Known by blocks (protocol/description/block_extremes.py): one is visible if the opacities of the densities between its
least and its greatest value are. That part fits by a ball about its middle, so that it stays in the image however it
is turned.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from volsplat.client.scene.resized import allowed_zoom
from volsplat.client.volume.enclosing_ball import Ball, Points, enclosing_ball, reach
from volsplat.client.volume.visible_blocks import block_shares, opacities
from volsplat.protocol.description.block_extremes import BlockExtremes, block_size
from volsplat.protocol.description.scene import TABLE_ENTRIES, Scene
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.resolved_view import FIT_FRACTION, resolved_bounds

FAINT = 0.01  # opacity: less is hardly seen
FAINT_SHARE = 0.1  # of the greatest opacity: nor is less than that, in a scene that is faint altogether
STRAY = 0.01  # of the visible blocks: so many that have no visible neighbour may be noise, and are left out

Row = tuple[int, int]  # blocks j, k
Indices = NDArray[np.int64]  # (n, 3) of i, j, k
CORNERS = np.array(list(product((0, 1), repeat=3)))  # of a box: whether each is at its end along i, j, k


def fitting_view(scene: Scene, geometry: Geometry, ball: Ball) -> tuple[float, Vector]:
    """Zoom and centre at which a ball of voxel centres, with their footprints, just fits into the scene's image."""
    half = FIT_FRACTION * min(scene.image.width, scene.image.height) / 2
    radius = scene.reconstruction.radius
    footprint = DEFAULT_RADIUS[scene.reconstruction.kernel] if radius == "default" else radius
    voxel = _longest_step(geometry)
    scale = half / (ball.radius + footprint * voxel)  # pixels per unit of length
    if scale * voxel < 1.0 and half > footprint and ball.radius > 0.0:  # footprints are then widened to pixels
        scale = min(scale, (half - footprint) / ball.radius)
    zoom = allowed_zoom(scale * geometry.reference_spacing)
    return zoom, matrices.applied(matrices.inverse(geometry.index_to_physical), ball.centre)


def visible_ball(scene: Scene, geometry: Geometry, quantisation: Quantisation, extremes: BlockExtremes) -> Ball:
    """The smallest ball of the visible voxels' centres, physical; about the view's centre where that is given.

    It lies relative to the centre of voxel (0, 0, 0): with an origin far away added, places would be rounded.
    Where nothing is visible, of all within the bounds; white edges are visible, too. Raises ValueError for bounds
    that the volume does not have.
    """
    bounds = resolved_bounds(scene, geometry)
    rows = _without_strays(_visible_rows(scene, geometry.dims, bounds, quantisation, extremes))
    corners = _corners(rows, geometry.dims, bounds) if rows else _corners_of(*map(np.atleast_2d, bounds))
    if scene.image.edges:
        corners = np.concatenate((corners, _corners_of(*map(np.atleast_2d, geometry.box))))
    points = _physical(geometry, corners)
    if scene.view.center == "middle":
        return enclosing_ball(points)
    centre = matrices.applied(geometry.index_to_physical, scene.view.center)
    return Ball(centre, reach(centre, points))


def _longest_step(geometry: Geometry) -> float:
    """No unit step of the grid, in whichever direction, is longer: the norm of the matrix is at most this."""
    m = geometry.index_to_physical
    by_rows = max(sum(abs(part) for part in row) for row in m)
    by_columns = max(sum(abs(part) for part in row) for row in matrices.transposed(m))
    return float((by_rows * by_columns) ** 0.5)


def _visible_rows(
    scene: Scene, dims: Index, bounds: Box, quantisation: Quantisation, extremes: BlockExtremes
) -> dict[Row, int]:
    """The visible blocks of each row along i as the bits of a number, block 0 lowest; rows without any are left out."""
    (i, j, k), shares = block_shares(_seen(scene), dims, bounds, quantisation, extremes)
    rows = np.packbits(shares > 0.0, axis=2, bitorder="little")
    visible = np.argwhere(rows.any(axis=2)).tolist()
    return {(j + dj, k + dk): int.from_bytes(rows[dk, dj].tobytes(), "little") << i for dk, dj in visible}


def _seen(scene: Scene) -> list[bool]:
    """Of each density byte whether it can well be seen. Indexed by another field, opacity may be anywhere."""
    known = opacities(scene)
    if known is None:
        return [True] * TABLE_ENTRIES
    least = min(FAINT, FAINT_SHARE * max(known))
    return [opacity > least for opacity in known]


def _without_strays(rows: dict[Row, int]) -> dict[Row, int]:
    """The rows without blocks that stand alone, unless such make up more of the picture than noise does."""
    around = [(dj, dk) for dj, dk in product((-1, 0, 1), repeat=2) if (dj, dk) != (0, 0)]
    kept = {}
    for (j, k), bits in rows.items():
        near = 0
        for dj, dk in around:
            near |= rows.get((j + dj, k + dk), 0)
        kept[j, k] = bits & (near | near << 1 | near >> 1 | bits << 1 | bits >> 1)
    visible = sum(bits.bit_count() for bits in rows.values())
    strays = visible - sum(bits.bit_count() for bits in kept.values())
    return {row: bits for row, bits in kept.items() if bits} if strays <= STRAY * visible else rows


def _corners(rows: dict[Row, int], dims: Index, bounds: Box) -> Indices:
    """Grid points about all voxel centres of the blocks within the bounds."""
    ends = [((bits & -bits).bit_length() - 1, bits.bit_length() - 1) for bits in rows.values()]
    first, last = (np.array([(i, *row) for i, row in zip(at, rows, strict=True)]) for at in zip(*ends, strict=True))
    size = block_size(dims)
    return _corners_of(np.maximum(first * size, bounds.low), np.minimum((last + 1) * size, bounds.high))


def _corners_of(low: Indices, high: Indices) -> Indices:
    """Eight of each box."""
    return np.stack((low, high - 1), axis=1)[:, CORNERS, np.arange(3)].reshape(-1, 3)


def _physical(geometry: Geometry, indices: Indices) -> Points:
    """Where each is from voxel (0, 0, 0), by the very operations of `matrices`."""
    i, j, k = indices.T.astype(np.float64)
    return np.stack([a * i + b * j + c * k for a, b, c in geometry.index_to_physical], axis=1)
