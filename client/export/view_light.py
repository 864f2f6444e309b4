"""The light of exported Gaussians, as it changes with the viewpoint: spherical harmonics, which viewers evaluate."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.rules.shading_rule import shading_rule

Light = Literal["viewer", "scene", "even"]
LIGHTS: tuple[Light, ...] = ("viewer", "scene", "even")
"""Anew for each viewpoint, as for the scene's view, or the same whichever way a voxel faces."""

HARMONICS = 16  # up to degree 3: as many as each file of Kerbl et al. has, and their viewer asks for
HARMONIC = 0.28209479177387814  # of degree 0, and below of degrees 1 to 3
FIRST = 0.4886025119029199
SECOND = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
THIRD = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)
BETWEEN = 30  # degrees between viewpoints that the harmonics are fitted to


def light_harmonics(voxels: Any, scene: Scene, light: Light) -> NDArray[np.float64]:
    """What multiplies the reflected colour: harmonics (codes, 16) by the code of a voxel's direction."""
    of_scene = voxels.fields.light(shading_rule(scene, Step.F).lighting).astype(np.float64)
    if light != "viewer":
        fixed = np.zeros((len(of_scene), HARMONICS))
        fixed[:, 0] = (of_scene if light == "scene" else 1.0) / HARMONIC
        return fixed
    lit, towards, weights = [], [], []
    for elevation in range(-90 + BETWEEN // 2, 90, BETWEEN):
        for azimuth in range(0, 360, BETWEEN):
            seen = scene.with_(rotation=(azimuth, elevation))
            lit.append(voxels.fields.light(shading_rule(seen, Step.F).lighting))
            towards.append(-np.array(screen_rotation(seen.view))[2])
            weights.append(math.sqrt(math.cos(math.radians(elevation))))
    weight = np.array(weights)[:, None]
    fitted: NDArray[np.float64] = (np.linalg.pinv(harmonics(np.array(towards)) * weight) @ (np.array(lit) * weight)).T
    return fitted


def harmonics(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those up to degree 3, (n, 16), ordered and signed as by Kerbl et al., of unit vectors (n, 3) from the eye."""
    x, y, z = towards.T
    xx, yy, zz = x * x, y * y, z * z
    first = (-FIRST * y, FIRST * z, -FIRST * x)
    a, b, c = SECOND
    second = (a * x * y, -a * y * z, b * (2 * zz - xx - yy), -a * x * z, c * (xx - yy))
    a, b, c, d, e = THIRD
    falling = (-a * y * (3 * xx - yy), b * x * y * z, -c * y * (4 * zz - xx - yy))
    rising = (-c * x * (4 * zz - xx - yy), e * z * (xx - yy), -a * x * (xx - 3 * yy))
    third = (*falling, d * z * (2 * zz - 3 * xx - 3 * yy), *rising)
    return np.stack([np.full(len(x), HARMONIC), *first, *second, *third], axis=-1)
