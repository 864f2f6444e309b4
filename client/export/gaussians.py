"""Visible voxels as the 3-D Gaussians of Kerbl et al. (2023), in the PLY file that viewers of Gaussian splats open.

A voxel's footprint is a Gaussian of GAUSSIAN_SIGMA voxels, scaled by the spacing, whose integral over the image is the
square of the reference spacing. Its greatest value is so 1 / (2 pi sigma^2), for unequal spacings on the geometric
mean over the axes, and a Gaussian of the file has that times the voxel's opacity: viewers then combine what `volsplat
render` combines.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volsplat.client.export.local_origin import NOWHERE_ELSE, local_origin, origin_text
from volsplat.client.export.view_light import HARMONIC, HARMONICS, Light, light_harmonics
from volsplat.client.files.whole_file import whole_file
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.rules.footprint_shape import GAUSSIAN_SIGMA
from volsplat.protocol.text.errors import BadInput

PEAK = 1.0 / (2.0 * math.pi * GAUSSIAN_SIGMA**2)  # of a footprint
LEAST_OPACITY = 1.0 / 255.0  # of a Gaussian: viewers leave out what is fainter
MOST_GAUSSIANS = 20_000_000  # 5 GB; viewers draw some millions
BEFORE_REST = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2".split()
REST = [f"f_rest_{n}" for n in range(3 * (HARMONICS - 1))]
AFTER_REST = "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
NAMES = [*BEFORE_REST, *REST, *AFTER_REST]
FEWER = "--every 2 takes each second voxel on each axis, --bounds a part, --window and --preset show less"


def write_gaussians(
    single: SingleProcess,
    scene: Scene,
    path: Path,
    every: int,
    light: Light,
    on_progress: Callable[[float], None],
) -> int:
    """Write a .ply file; how many Gaussians it holds. Raises BadInput if there are none, or too many.

    `on_progress` hears of the share that is done.
    """
    voxels = single.voxels(scene, every)
    by_direction = light_harmonics(voxels, single.volume.settled(scene), light)
    least, sheets = LEAST_OPACITY / PEAK, max(2 * voxels.sheets, 1)
    count = 0
    for done, found in enumerate(voxels.counts(least), 1):
        count += found
        on_progress(done / sheets)
    _check_count(count)
    to_physical = np.array(voxels.level.index_to_physical)
    geometry = voxels.fields.drawing.geometry
    local = local_origin(single.volume.description.geometry)
    origin = np.array(voxels.level.origin) - np.array(local)
    scales, rotation = ellipsoid(every * to_physical)
    with whole_file(path) as file:
        file.write(_header(count, geometry, local))
        for done, some in enumerate(voxels.visible(least), 1):
            rows = np.zeros((len(some.indices), len(NAMES)), dtype="<f4")
            rows[:, 0:3] = some.indices @ to_physical.T + origin
            rows[:, 6:-8] = _colours(some.emitted, some.reflected, by_direction[some.directions])
            alpha = PEAK * some.opacity.astype(np.float64)
            rows[:, -8] = np.log(alpha / (1.0 - alpha))
            rows[:, -7:-4] = np.log(scales)
            rows[:, -4:] = rotation
            file.write(rows.tobytes())
            on_progress(0.5 + done / sheets)
    return count


def _colours(
    emitted: NDArray[np.float32], reflected: NDArray[np.float32], light: NDArray[np.float64]
) -> NDArray[np.float64]:
    """f_dc and f_rest, (n, 3) and (n, 3 * (harmonics - 1)), side by side: all of red, of green, of blue."""
    average = emitted + reflected * light[:, :1] * HARMONIC
    rest = (reflected[:, :, None] * light[:, None, 1:]).reshape(len(light), 3 * (light.shape[1] - 1))
    return np.concatenate([(np.clip(average, 0.0, 1.0) - 0.5) / HARMONIC, rest], axis=1)


def ellipsoid(index_to_physical: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The deviations along the axes of a voxel's Gaussian, and the quaternion (w, x, y, z) that turns them into place.

    Its covariance is sigma^2 A A^T, A being the matrix: a sheared voxel has axes that are not the grid's.
    """
    axes, lengths, _ = np.linalg.svd(index_to_physical)
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] = -axes[:, 2]  # an ellipsoid is its own mirror image
    return GAUSSIAN_SIGMA * lengths, _quaternion(axes)


def _quaternion(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(w, x, y, z) of a rotation: the eigenvector of Bar-Itzhack's matrix for its greatest eigenvalue."""
    r = rotation
    symmetric = np.array(
        [
            [r.trace(), r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0.0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0.0, 0.0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0.0, 0.0, 0.0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    _, vectors = np.linalg.eigh(symmetric, UPLO="U")
    greatest: NDArray[np.float64] = vectors[:, -1]
    return greatest


def _check_count(count: int) -> None:
    if count == 0:
        raise BadInput(
            "nothing to export: every voxel of this scene is too faint for a viewer of Gaussians; give another "
            "--preset or --window, or --every 2, which makes voxels larger and less faint"
        )
    if count > MOST_GAUSSIANS:
        raise BadInput(f"{count} voxels are visible, more than the {MOST_GAUSSIANS} of a file; {FEWER}")


def _header(count: int, geometry: Geometry, local: Vector) -> bytes:
    properties = "".join(f"property float {name}\n" for name in NAMES)
    dims = geometry.dims
    made = f"comment volsplat export of {dims[0]} x {dims[1]} x {dims[2]} voxels\n"
    if local != NOWHERE_ELSE:
        made += f"comment x, y, z are counted from {origin_text(local, geometry.spacing)}\n"
    return f"ply\nformat binary_little_endian 1.0\n{made}element vertex {count}\n{properties}end_header\n".encode()
